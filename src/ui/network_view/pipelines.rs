//! How the graphics card draws points, lines, ellipsoids and the finished picture.

use super::instances::EllipsoidInstance;
use super::instances::LineInstance;
use super::instances::PointInstance;
use super::instances::Sphere;
use super::render::ViewUniform;
use wgpu::util::DeviceExt as _;

/// Samples a pixel; every adapter can do four.
pub(super) const SAMPLES: u32 = 4;
/// With more ellipsoids than this, each gets fewer triangles.
const MANY_ELLIPSOIDS: u32 = 1500;

/// Fields of [`PointInstance`].
const POINT_ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32, 2 => Unorm8x4, 3 => Unorm8x4, 4 => Uint32];
/// Fields of [`LineInstance`].
const LINE_ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32, 2 => Float32x3, 3 => Float32, 4 => Unorm8x4];
/// Corners of the sphere.
const CORNER_ATTRIBUTES: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
/// Fields of [`EllipsoidInstance`].
const ELLIPSOID_ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![1 => Float32x3, 2 => Float32x3, 3 => Float32x3, 4 => Float32x3, 5 => Unorm8x4];

/// A sphere on the card.
pub(super) struct SphereMesh {
    pub(super) corners: wgpu::Buffer,
    pub(super) triangles: wgpu::Buffer,
    pub(super) count: u32,
}

impl SphereMesh {
    fn new(device: &wgpu::Device, rings: u16) -> Self {
        let mut sphere = Sphere::new(rings);
        let count = sphere.triangles.len() as u32;
        // Buffers are loaded in steps of four bytes.
        sphere
            .triangles
            .resize(sphere.triangles.len().next_multiple_of(2), 0);
        let load = |contents: &[u8], usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("sphere"),
                contents,
                usage,
            })
        };
        Self {
            corners: load(
                bytemuck::cast_slice(&sphere.corners),
                wgpu::BufferUsages::VERTEX,
            ),
            triangles: load(
                bytemuck::cast_slice(&sphere.triangles),
                wgpu::BufferUsages::INDEX,
            ),
            count,
        }
    }
}

/// All pipelines of the 3D view.
pub(super) struct Pipelines {
    uniform_layout: wgpu::BindGroupLayout,
    picture_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    fine_sphere: SphereMesh,
    coarse_sphere: SphereMesh,
    pub(super) points: wgpu::RenderPipeline,
    pub(super) points_on_top: wgpu::RenderPipeline,
    pub(super) lines: wgpu::RenderPipeline,
    pub(super) ellipsoids: wgpu::RenderPipeline,
    pub(super) blit: wgpu::RenderPipeline,
}

/// Depth in the 3D picture.
#[derive(Clone, Copy)]
enum Depth {
    /// Hides what is behind and is hidden by what is before.
    Solid,
    /// Is hidden by what is before, hides nothing.
    Tested,
    /// Stands before everything.
    OnTop,
    /// The picture has no depth.
    Absent,
}

/// One pipeline to make.
struct Recipe<'a> {
    vertex: &'a str,
    fragment: &'a str,
    buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    topology: wgpu::PrimitiveTopology,
    layout: &'a wgpu::BindGroupLayout,
    format: wgpu::TextureFormat,
    depth: Depth,
    blend: Option<wgpu::BlendState>,
    alpha_to_coverage_enabled: bool,
}

impl Pipelines {
    /// Format of the picture's colours: as egui's, encoded.
    pub(super) const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
    /// Format of its depth.
    pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

    pub(super) fn new(device: &wgpu::Device, target: wgpu::TextureFormat) -> Self {
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("3D view"),
            source: wgpu::ShaderSource::Wgsl(include_str!("shaders.wgsl").into()),
        });
        let uniform_layout = uniform_layout(device);
        let picture_layout = picture_layout(device);
        let point_layout = instances::<PointInstance>(&POINT_ATTRIBUTES);
        let line_layout = instances::<LineInstance>(&LINE_ATTRIBUTES);
        let corner_layout = wgpu::VertexBufferLayout {
            array_stride: size_of::<[f32; 3]>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &CORNER_ATTRIBUTES,
        };
        let ellipsoid_layout = instances::<EllipsoidInstance>(&ELLIPSOID_ATTRIBUTES);
        let (point_layout, line_layout) = ([Some(point_layout)], [Some(line_layout)]);
        let points = |depth| Recipe {
            vertex: "point_vertex",
            fragment: "point_fragment",
            buffers: &point_layout,
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            layout: &uniform_layout,
            format: Self::COLOUR,
            depth,
            blend: None,
            alpha_to_coverage_enabled: true,
        };
        let lines = Recipe {
            vertex: "line_vertex",
            fragment: "line_fragment",
            buffers: &line_layout,
            blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
            alpha_to_coverage_enabled: false,
            ..points(Depth::Tested)
        };
        let ellipsoids = Recipe {
            vertex: "ellipsoid_vertex",
            fragment: "ellipsoid_fragment",
            buffers: &[Some(corner_layout), Some(ellipsoid_layout)],
            topology: wgpu::PrimitiveTopology::TriangleList,
            alpha_to_coverage_enabled: false,
            ..points(Depth::Solid)
        };
        let blit = Recipe {
            vertex: "blit_vertex",
            fragment: if target.is_srgb() {
                "blit_linear"
            } else {
                "blit_gamma"
            },
            buffers: &[],
            layout: &picture_layout,
            format: target,
            alpha_to_coverage_enabled: false,
            ..points(Depth::Absent)
        };
        Self {
            sampler: device.create_sampler(&wgpu::SamplerDescriptor::default()),
            fine_sphere: SphereMesh::new(device, 9),
            coarse_sphere: SphereMesh::new(device, 3),
            points: points(Depth::Solid).make(device, &shader),
            points_on_top: points(Depth::OnTop).make(device, &shader),
            lines: lines.make(device, &shader),
            ellipsoids: ellipsoids.make(device, &shader),
            blit: blit.make(device, &shader),
            uniform_layout,
            picture_layout,
        }
    }

    /// A sphere with as many triangles as this many ellipsoids can have.
    pub(super) fn sphere_for(&self, ellipsoids: u32) -> &SphereMesh {
        if ellipsoids > MANY_ELLIPSOIDS {
            &self.coarse_sphere
        } else {
            &self.fine_sphere
        }
    }

    /// The viewpoint of a view, as the shaders find it.
    pub(super) fn bind_uniform(
        &self,
        device: &wgpu::Device,
        uniform: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("3D view"),
            layout: &self.uniform_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: uniform.as_entire_binding(),
            }],
        })
    }

    /// The finished picture of a view, as the last shader finds it.
    pub(super) fn bind_picture(
        &self,
        device: &wgpu::Device,
        picture: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("3D view"),
            layout: &self.picture_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(picture),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        })
    }
}

impl Recipe<'_> {
    fn make(&self, device: &wgpu::Device, module: &wgpu::ShaderModule) -> wgpu::RenderPipeline {
        let depth_stencil = |write, compare| wgpu::DepthStencilState {
            format: Pipelines::DEPTH,
            depth_write_enabled: Some(write),
            depth_compare: Some(compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        };
        let depth_stencil = match self.depth {
            Depth::Solid => Some(depth_stencil(true, wgpu::CompareFunction::GreaterEqual)),
            Depth::Tested => Some(depth_stencil(false, wgpu::CompareFunction::GreaterEqual)),
            Depth::OnTop => Some(depth_stencil(false, wgpu::CompareFunction::Always)),
            Depth::Absent => None,
        };
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.vertex),
            bind_group_layouts: &[Some(self.layout)],
            immediate_size: 0,
        });
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.vertex),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(self.vertex),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState {
                topology: self.topology,
                ..Default::default()
            },
            multisample: wgpu::MultisampleState {
                count: if depth_stencil.is_some() { SAMPLES } else { 1 },
                mask: !0,
                alpha_to_coverage_enabled: self.alpha_to_coverage_enabled,
            },
            depth_stencil,
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some(self.fragment),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format: self.format,
                    blend: self.blend,
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

fn instances<T>(attributes: &[wgpu::VertexAttribute]) -> wgpu::VertexBufferLayout<'_> {
    wgpu::VertexBufferLayout {
        array_stride: size_of::<T>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes,
    }
}

fn uniform_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("3D view"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: wgpu::BufferSize::new(size_of::<ViewUniform>() as u64),
            },
            count: None,
        }],
    })
}

fn picture_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("3D view"),
        entries: &[
            wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
                count: None,
            },
            wgpu::BindGroupLayoutEntry {
                binding: 1,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                count: None,
            },
        ],
    })
}
