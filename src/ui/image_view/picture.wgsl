// Tiles of a grey picture; window and level are applied here.

struct Shown {
    black: f32,
    white: f32,
    // 1: grey values of one byte; 2: high and low byte.
    bytes: f32,
    // 1: the target turns linear light into sRGB by itself.
    srgb: f32,
}

@group(0) @binding(0) var<uniform> shown: Shown;
@group(0) @binding(1) var filtering: sampler;
@group(1) @binding(0) var tile: texture_2d<f32>;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) texture: vec2<f32>,
}

@vertex
fn corner(
    @builtin(vertex_index) index: u32,
    @location(0) screen: vec4<f32>,
    @location(1) texture: vec4<f32>,
) -> Corner {
    let share = vec2<f32>(f32(index & 1u), f32(index >> 1u));
    var out: Corner;
    out.position = vec4<f32>(mix(screen.xy, screen.zw, share), 0.0, 1.0);
    out.texture = mix(texture.xy, texture.zw, share);
    return out;
}

@fragment
fn grey(in: Corner) -> @location(0) vec4<f32> {
    let texel = textureSample(tile, filtering, in.texture);
    let both = (texel.r * 65280.0 + texel.g * 255.0) / 65535.0;
    let value = select(texel.r, both, shown.bytes > 1.5);
    var light = clamp((value - shown.black) / max(shown.white - shown.black, 1e-6), 0.0, 1.0);
    if shown.srgb > 0.5 {
        light = pow(light, 2.2);
    }
    return vec4<f32>(light, light, light, 1.0);
}
