struct View {
    clip_from_scene: mat4x4<f32>,
    // To the eye, in the scene.
    towards: vec4<f32>,
    size_px: vec2<f32>,
    px_per_point: f32,
    time: f32,
    fade: f32,
    near: f32,
    unused: vec2<f32>,
};
@group(0) @binding(0) var<uniform> view: View;

// Corners of a quad as a triangle strip.
fn corner(index: u32) -> vec2<f32> {
    return vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 2.0 - 1.0;
}

// ---- points ----
struct PointIn {
    @location(0) position: vec3<f32>,
    @location(1) size: f32,
    @location(2) colour: vec4<f32>,
    @location(3) rim: vec4<f32>,
    @location(4) marker: u32,
};
struct PointOut {
    @builtin(position) clip: vec4<f32>,
    // From the centre, screen pixels, y up.
    @location(0) offset: vec2<f32>,
    @location(1) @interpolate(flat) radius: f32,
    @location(2) @interpolate(flat) colour: vec4<f32>,
    @location(3) @interpolate(flat) rim: vec4<f32>,
    @location(4) @interpolate(flat) marker: u32,
};

@vertex
fn point_vertex(@builtin(vertex_index) index: u32, in: PointIn) -> PointOut {
    var out: PointOut;
    let radius = 0.5 * in.size * view.px_per_point;
    let offset = corner(index) * (radius + 1.0);
    var clip = view.clip_from_scene * vec4<f32>(in.position, 1.0);
    clip = vec4<f32>(clip.xy + offset * 2.0 / view.size_px * clip.w, clip.z, clip.w);
    // A little nearer, so that lines end at points and do not cross them.
    clip.z = clip.z * 1.002;
    out.clip = clip;
    out.offset = offset;
    out.radius = radius;
    out.colour = in.colour;
    out.rim = in.rim;
    out.marker = in.marker;
    return out;
}

// Signed distance from the outline, pixels, negative inside.
fn outline(offset: vec2<f32>, radius: f32, marker: u32) -> f32 {
    if marker == 1u {
        return (abs(offset.x) + abs(offset.y) - radius) * 0.7071;
    }
    if marker == 2u {
        let sides = 0.866 * abs(offset.x) + 0.5 * offset.y - 0.5 * radius;
        return max(sides, -offset.y - 0.5 * radius);
    }
    if marker == 3u {
        let width = 1.25 * view.px_per_point;
        return abs(length(offset) - (radius - width - view.px_per_point)) - width;
    }
    return length(offset) - radius;
}

@fragment
fn point_fragment(in: PointOut) -> @location(0) vec4<f32> {
    let rim_width = view.px_per_point;
    // The ring's rim stands outside of it, the others' inside.
    let grown = select(0.0, rim_width, in.marker == 3u);
    let distance = outline(in.offset, in.radius, in.marker) - grown;
    let coverage = clamp(0.5 - distance, 0.0, 1.0);
    if coverage <= 0.0 {
        discard;
    }
    let inner = clamp(0.5 - (distance + rim_width), 0.0, 1.0);
    return vec4<f32>(mix(in.rim.rgb, in.colour.rgb, inner), coverage);
}

// ---- lines ----
struct LineIn {
    @location(0) start: vec3<f32>,
    @location(1) width: f32,
    @location(2) end: vec3<f32>,
    @location(3) birth: f32,
    @location(4) colour: vec4<f32>,
};
struct LineOut {
    @builtin(position) clip: vec4<f32>,
    @location(0) colour: vec4<f32>,
};

@vertex
fn line_vertex(@builtin(vertex_index) index: u32, in: LineIn) -> LineOut {
    var out: LineOut;
    var a = view.clip_from_scene * vec4<f32>(in.start, 1.0);
    var b = view.clip_from_scene * vec4<f32>(in.end, 1.0);
    let side = corner(index);
    if a.w < view.near && b.w < view.near {
        // Behind the eye: no area.
        out.clip = vec4<f32>(2.0, 2.0, 0.0, 1.0);
        return out;
    }
    if a.w < view.near {
        a = mix(a, b, (view.near - a.w) / (b.w - a.w));
    } else if b.w < view.near {
        b = mix(b, a, (view.near - b.w) / (a.w - b.w));
    }
    let half_size = 0.5 * view.size_px;
    let along = (b.xy / b.w - a.xy / a.w) * half_size;
    let long = max(length(along), 1e-6);
    let across = vec2<f32>(-along.y, along.x) / long;
    let width = max(in.width * view.px_per_point, 1.0);
    var clip = select(a, b, side.x > 0.0);
    clip = vec4<f32>(clip.xy + across * side.y * 0.5 * width / half_size * clip.w, clip.z, clip.w);
    let age = clamp((view.time - in.birth) / view.fade, 0.0, 1.0);
    let alpha = in.colour.a * age;
    out.clip = clip;
    out.colour = vec4<f32>(in.colour.rgb * alpha, alpha);
    return out;
}

@fragment
fn line_fragment(in: LineOut) -> @location(0) vec4<f32> {
    return in.colour;
}

// ---- ellipsoids ----
struct EllipsoidIn {
    @location(0) corner: vec3<f32>,
    @location(1) centre: vec3<f32>,
    @location(2) column0: vec3<f32>,
    @location(3) column1: vec3<f32>,
    @location(4) column2: vec3<f32>,
    @location(5) colour: vec4<f32>,
};
struct EllipsoidOut {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) @interpolate(flat) colour: vec4<f32>,
};

@vertex
fn ellipsoid_vertex(in: EllipsoidIn) -> EllipsoidOut {
    var out: EllipsoidOut;
    let m = mat3x3<f32>(in.column0, in.column1, in.column2);
    out.clip = view.clip_from_scene * vec4<f32>(in.centre + m * in.corner, 1.0);
    // The cofactors are the inverse transpose up to a positive factor; scaled, so that small ones do not vanish.
    let size = max(max(length(in.column0), length(in.column1)), max(length(in.column2), 1e-20));
    let a = in.column0 / size;
    let b = in.column1 / size;
    let c = in.column2 / size;
    out.normal = cross(b, c) * in.corner.x + cross(c, a) * in.corner.y + cross(a, b) * in.corner.z;
    out.colour = in.colour;
    return out;
}

@fragment
fn ellipsoid_fragment(in: EllipsoidOut) -> @location(0) vec4<f32> {
    let normal = in.normal / max(length(in.normal), 1e-20);
    let light = 0.35 + 0.65 * max(dot(normal, view.towards.xyz), 0.0);
    return vec4<f32>(in.colour.rgb * light, 1.0);
}

// ---- the finished picture onto the window ----
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var nearest: sampler;
struct BlitOut {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
};

@vertex
fn blit_vertex(@builtin(vertex_index) index: u32) -> BlitOut {
    var out: BlitOut;
    let place = corner(index);
    out.clip = vec4<f32>(place, 0.0, 1.0);
    out.uv = vec2<f32>(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y);
    return out;
}

@fragment
fn blit_gamma(in: BlitOut) -> @location(0) vec4<f32> {
    return vec4<f32>(textureSample(picture, nearest, in.uv).rgb, 1.0);
}

// For a window whose surface encodes by itself.
@fragment
fn blit_linear(in: BlitOut) -> @location(0) vec4<f32> {
    let rgb = textureSample(picture, nearest, in.uv).rgb;
    let low = rgb / 12.92;
    let high = pow((rgb + 0.055) / 1.055, vec3<f32>(2.4));
    return vec4<f32>(select(high, low, rgb < vec3<f32>(0.04045)), 1.0);
}
