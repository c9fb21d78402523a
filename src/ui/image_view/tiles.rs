//! The picture on the graphics card: tiles with mip levels, uploaded a few a frame, window and level in the shader.
//!
//! Pictures of 8 bits are `R8Unorm`; those of 16 bits are `Rg8Unorm` with the high and the low byte, which every
//! driver filters and no feature is needed for: both bytes are interpolated linearly, so their sum is.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use eframe::egui_wgpu::{CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use egui::{PaintCallbackInfo, Rect};
use nalgebra::Vector2;

use super::levels::{APRON, Level, SIDE, STEP};
use super::transform::ScreenFromImage;
use super::window::GreyWindow;
use crate::imaging::{BitDepth, GreyImage};
use crate::network::ImageId;

/// Mip levels of a tile: 512 px down to 16.
const LEVELS: u32 = 6;
/// Tiles that one view uploads in one frame: some 2 ms.
const TILES_A_FRAME: usize = 6;
/// Tiles held in all, 350 kB each with 8 bits.
const MOST_TILES: usize = 1200;
/// Above this many screen pixels a picture pixel its square is shown.
const NEAREST_ABOVE: f64 = 4.0;

/// Prepares drawing pictures with this renderer; once, where the window starts. The renderer has no depth buffer and no
/// multisampling, as in eframe's default.
pub fn install(render_state: &RenderState) {
    let gpu = Gpu::new(&render_state.device, render_state.target_format);
    render_state.renderer.write().callback_resources.insert(gpu);
}

/// One picture drawn in one rectangle.
pub(super) struct PictureCallback {
    /// Tells this rectangle from others.
    pub(super) view: u64,
    pub(super) image: ImageId,
    pub(super) picture: Arc<GreyImage>,
    pub(super) transform: ScreenFromImage,
    pub(super) rect: Rect,
    pub(super) window: GreyWindow,
    pub(super) context: egui::Context,
}

struct Gpu {
    pipeline: wgpu::RenderPipeline,
    view_layout: wgpu::BindGroupLayout,
    tile_layout: wgpu::BindGroupLayout,
    nearest: wgpu::Sampler,
    linear: wgpu::Sampler,
    is_srgb: bool,
    pictures: BTreeMap<ImageId, Textures>,
    views: BTreeMap<u64, View>,
    clock: u64,
}

struct Textures {
    /// Which picture it is, without keeping it in memory.
    picture: Weak<GreyImage>,
    overview: wgpu::BindGroup,
    tiles: BTreeMap<[usize; 2], wgpu::BindGroup>,
    used: u64,
}

struct View {
    uniform: wgpu::Buffer,
    nearest: wgpu::BindGroup,
    linear: wgpu::BindGroup,
    corners: wgpu::Buffer,
    capacity: usize,
    image: ImageId,
    magnified: Magnified,
    /// Tiles in the order of their corners, after the overview.
    drawn: Vec<[usize; 2]>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Magnified {
    Squares,
    Smooth,
}

/// Screen and texture corners of a quad: x0, y0, x1, y1 in normalised device coordinates, then u0, v0, u1, v1.
type Quad = [f32; 8];

impl CallbackTrait for PictureCallback {
    fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        screen: &ScreenDescriptor,
        _encoder: &mut wgpu::CommandEncoder,
        resources: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        if let Some(gpu) = resources.get_mut::<Gpu>() {
            gpu.prepare(self, device, queue, screen);
        }
        Vec::new()
    }

    fn paint(
        &self,
        info: PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        resources: &CallbackResources,
    ) {
        let Some(gpu) = resources.get::<Gpu>() else {
            return;
        };
        let [width, height] = info.screen_size_px;
        // Corners are given on the whole screen, so a rectangle that is partly off it is no special case.
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        gpu.paint(self, pass);
    }
}

impl PictureCallback {
    /// The tiles of the picture that the rectangle shows.
    fn visible_tiles(&self) -> Vec<[usize; 2]> {
        let visible = self.transform.visible(self.rect);
        let range = |low: f64, high: f64, side: usize| {
            let last = side.saturating_sub(1) / STEP;
            let first = (low / STEP as f64).floor().max(0.0) as usize;
            let end = ((high / STEP as f64).floor().max(-1.0) + 1.0) as usize;
            first..end.min(last + 1)
        };
        let columns = range(visible.min.x, visible.max.x, self.picture.width());
        let rows = range(visible.min.y, visible.max.y, self.picture.height());
        rows.flat_map(|row| columns.clone().map(move |column| [column, row]))
            .collect()
    }

    fn quad(
        &self,
        screen: &ScreenDescriptor,
        place: [[f64; 2]; 2],
        texture: [[f32; 2]; 2],
    ) -> Quad {
        let size = screen.size_in_pixels;
        let device = |corner: [f64; 2]| {
            let point =
                self.transform.origin + Vector2::new(corner[0], corner[1]) * self.transform.scale;
            let per_point = f64::from(screen.pixels_per_point);
            [
                (point.x * per_point / f64::from(size[0].max(1)) * 2.0 - 1.0) as f32,
                (1.0 - point.y * per_point / f64::from(size[1].max(1)) * 2.0) as f32,
            ]
        };
        let ([x0, y0], [x1, y1]) = (device(place[0]), device(place[1]));
        [
            x0,
            y0,
            x1,
            y1,
            texture[0][0],
            texture[0][1],
            texture[1][0],
            texture[1][1],
        ]
    }

    fn tile_quad(&self, screen: &ScreenDescriptor, [column, row]: [usize; 2]) -> Quad {
        let (x0, y0) = (column * STEP, row * STEP);
        let (x1, y1) = (
            (x0 + STEP).min(self.picture.width()),
            (y0 + STEP).min(self.picture.height()),
        );
        let coordinate = |offset: usize| (APRON + offset) as f32 / SIDE as f32;
        self.quad(
            screen,
            [[x0 as f64, y0 as f64], [x1 as f64, y1 as f64]],
            [
                [coordinate(0), coordinate(0)],
                [coordinate(x1 - x0), coordinate(y1 - y0)],
            ],
        )
    }
}

impl Gpu {
    fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let view_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("picture view"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
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
        });
        let tile_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("picture tile"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Texture {
                    multisampled: false,
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                },
                count: None,
            }],
        });
        let sampler = |mag_filter| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("picture"),
                mag_filter,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            })
        };
        Self {
            pipeline: pipeline(device, format, &view_layout, &tile_layout),
            nearest: sampler(wgpu::FilterMode::Nearest),
            linear: sampler(wgpu::FilterMode::Linear),
            is_srgb: format.is_srgb(),
            view_layout,
            tile_layout,
            pictures: BTreeMap::new(),
            views: BTreeMap::new(),
            clock: 0,
        }
    }

    fn prepare(
        &mut self,
        callback: &PictureCallback,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        screen: &ScreenDescriptor,
    ) {
        self.clock += 1;
        let upload = Upload {
            device,
            queue,
            layout: &self.tile_layout,
        };
        let known = self.pictures.get(&callback.image);
        let picture = Arc::as_ptr(&callback.picture);
        if known.is_none_or(|known| known.picture.as_ptr() != picture) {
            let textures = Textures {
                picture: Arc::downgrade(&callback.picture),
                overview: upload.overview(&callback.picture),
                tiles: BTreeMap::new(),
                used: self.clock,
            };
            self.pictures.insert(callback.image, textures);
        }
        let Some(textures) = self.pictures.get_mut(&callback.image) else {
            return;
        };
        textures.used = self.clock;
        let visible = callback.visible_tiles();
        let mut left = TILES_A_FRAME;
        for place in &visible {
            if textures.tiles.contains_key(place) {
                continue;
            }
            if left == 0 {
                callback.context.request_repaint();
                break;
            }
            left -= 1;
            textures
                .tiles
                .insert(*place, upload.tile(&callback.picture, *place));
        }
        let drawn: Vec<[usize; 2]> = visible
            .into_iter()
            .filter(|place| textures.tiles.contains_key(place))
            .collect();
        self.write_view(callback, device, queue, screen, drawn);
        self.forget_old();
    }

    fn write_view(
        &mut self,
        callback: &PictureCallback,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        screen: &ScreenDescriptor,
        drawn: Vec<[usize; 2]>,
    ) {
        let (width, height) = (
            callback.picture.width() as f64,
            callback.picture.height() as f64,
        );
        let mut quads =
            vec![callback.quad(screen, [[0.0, 0.0], [width, height]], [[0.0; 2], [1.0; 2]])];
        quads.extend(drawn.iter().map(|place| callback.tile_quad(screen, *place)));
        let needed = quads.len();
        let view = match self.views.remove(&callback.view) {
            Some(view) if view.capacity >= needed => view,
            _ => self.new_view(device, callback.image, needed.next_power_of_two().max(64)),
        };
        queue.write_buffer(&view.corners, 0, bytemuck::cast_slice(&quads));
        let white = f64::from(callback.picture.depth().white());
        let bytes = match callback.picture.depth() {
            BitDepth::Eight => 1.0,
            BitDepth::Sixteen => 2.0,
        };
        let uniform: [f32; 4] = [
            (callback.window.black / white) as f32,
            (callback.window.white / white) as f32,
            bytes,
            f32::from(u8::from(self.is_srgb)),
        ];
        queue.write_buffer(&view.uniform, 0, bytemuck::cast_slice(&uniform));
        let magnification = callback.transform.scale * f64::from(screen.pixels_per_point);
        let magnified = if magnification > NEAREST_ABOVE {
            Magnified::Squares
        } else {
            Magnified::Smooth
        };
        self.views.insert(
            callback.view,
            View {
                image: callback.image,
                magnified,
                drawn,
                ..view
            },
        );
    }

    fn new_view(&self, device: &wgpu::Device, image: ImageId, capacity: usize) -> View {
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture window"),
            size: 16,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let corners = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture tiles"),
            size: (capacity * size_of::<Quad>()) as u64,
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = |sampler: &wgpu::Sampler| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("picture view"),
                layout: &self.view_layout,
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: uniform.as_entire_binding(),
                    },
                    wgpu::BindGroupEntry {
                        binding: 1,
                        resource: wgpu::BindingResource::Sampler(sampler),
                    },
                ],
            })
        };
        View {
            nearest: group(&self.nearest),
            linear: group(&self.linear),
            uniform,
            corners,
            capacity,
            image,
            magnified: Magnified::Smooth,
            drawn: Vec::new(),
        }
    }

    /// Lets the pictures go that were not drawn for longest.
    fn forget_old(&mut self) {
        /// Views are few: what was drawn within so many calls is on the screen.
        const ON_SCREEN: u64 = 64;
        while self
            .pictures
            .values()
            .map(|textures| textures.tiles.len())
            .sum::<usize>()
            > MOST_TILES
        {
            let oldest = self
                .pictures
                .iter()
                .min_by_key(|(_, textures)| textures.used);
            let Some((&image, textures)) = oldest else {
                return;
            };
            if textures.used + ON_SCREEN >= self.clock {
                return;
            }
            self.pictures.remove(&image);
        }
    }

    fn paint(&self, callback: &PictureCallback, pass: &mut wgpu::RenderPass<'static>) {
        let Some(view) = self.views.get(&callback.view) else {
            return;
        };
        let Some(textures) = self.pictures.get(&view.image) else {
            return;
        };
        pass.set_pipeline(&self.pipeline);
        let group = match view.magnified {
            Magnified::Squares => &view.nearest,
            Magnified::Smooth => &view.linear,
        };
        pass.set_bind_group(0, group, &[]);
        pass.set_vertex_buffer(0, view.corners.slice(..));
        pass.set_bind_group(1, &textures.overview, &[]);
        pass.draw(0..4, 0..1);
        for (slot, place) in (1..).zip(&view.drawn) {
            if let Some(tile) = textures.tiles.get(place) {
                pass.set_bind_group(1, tile, &[]);
                pass.draw(0..4, slot..slot + 1);
            }
        }
    }
}

fn pipeline(
    device: &wgpu::Device,
    format: wgpu::TextureFormat,
    view_layout: &wgpu::BindGroupLayout,
    tile_layout: &wgpu::BindGroupLayout,
) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("picture"),
        source: wgpu::ShaderSource::Wgsl(include_str!("picture.wgsl").into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("picture"),
        bind_group_layouts: &[Some(view_layout), Some(tile_layout)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("picture"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Quad>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4],
            })],
            compilation_options: wgpu::PipelineCompilationOptions::default(),
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..Default::default()
        },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("grey"),
            targets: &[Some(format.into())],
            compilation_options: wgpu::PipelineCompilationOptions::default(),
        }),
        multiview_mask: None,
        cache: None,
    })
}

struct Upload<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    layout: &'a wgpu::BindGroupLayout,
}

impl Upload<'_> {
    fn tile(&self, picture: &GreyImage, place: [usize; 2]) -> wgpu::BindGroup {
        let mut levels = vec![Level::of_tile(picture, place)];
        for _ in 1..LEVELS {
            let next = levels[levels.len() - 1].halved();
            levels.push(next);
        }
        self.texture(&levels, picture.depth())
    }

    fn overview(&self, picture: &GreyImage) -> wgpu::BindGroup {
        let level = if picture.samples().is_empty() {
            Level {
                width: 1,
                height: 1,
                grey: vec![0],
            }
        } else {
            Level::overview(picture)
        };
        self.texture(&[level], picture.depth())
    }

    fn texture(&self, levels: &[Level], depth: BitDepth) -> wgpu::BindGroup {
        let (format, pixel_bytes) = match depth {
            BitDepth::Eight => (wgpu::TextureFormat::R8Unorm, 1),
            BitDepth::Sixteen => (wgpu::TextureFormat::Rg8Unorm, 2),
        };
        let size = |level: &Level| wgpu::Extent3d {
            width: level.width as u32,
            height: level.height as u32,
            depth_or_array_layers: 1,
        };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture tile"),
            size: size(&levels[0]),
            mip_level_count: levels.len() as u32,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        for (mip_level, level) in (0..).zip(levels) {
            self.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &texture,
                    mip_level,
                    origin: wgpu::Origin3d::ZERO,
                    aspect: wgpu::TextureAspect::All,
                },
                &level.bytes(depth),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(level.width as u32 * pixel_bytes),
                    rows_per_image: None,
                },
                size(level),
            );
        }
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("picture tile"),
            layout: self.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&view),
            }],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::pos2;

    fn picture(width: u32, height: u32) -> GreyImage {
        let samples = (0..height).flat_map(|y| (0..width).map(move |x| ((x + 3 * y) % 251) as u16));
        GreyImage::new(width, height, BitDepth::Eight, samples.collect()).unwrap()
    }

    #[test]
    fn only_tiles_in_sight_are_drawn() {
        let callback = |scale: f64| PictureCallback {
            view: 1,
            image: ImageId(1),
            picture: Arc::new(picture(2000, 1100)),
            transform: ScreenFromImage {
                scale,
                origin: Vector2::zeros(),
            },
            rect: Rect::from_min_max(pos2(0.0, 0.0), pos2(600.0, 400.0)),
            window: GreyWindow {
                black: 0.0,
                white: 255.0,
            },
            context: egui::Context::default(),
        };
        assert_eq!(callback(1.0).visible_tiles(), [[0, 0], [1, 0]]);
        assert_eq!(callback(0.1).visible_tiles().len(), 12);
    }
}
