//! Draws layers into a picture of its own, with depth and four samples a pixel (egui's pass has neither), and copies it
//! onto the window. Nothing is drawn again while viewpoint, size and layers stay as they are.

use std::collections::BTreeMap;
use std::sync::Arc;

use bytemuck::Pod;
use bytemuck::Zeroable;
use eframe::egui_wgpu;
use eframe::egui_wgpu::CallbackResources;
use eframe::egui_wgpu::CallbackTrait;
use eframe::egui_wgpu::RenderState;
use eframe::egui_wgpu::ScreenDescriptor;
use egui::Color32;
use egui::PaintCallbackInfo;
use egui::Rect;
use wgpu::util::DeviceExt as _;

use super::instances::Layer;
use super::pipelines::Pipelines;
use super::pipelines::SAMPLES;

/// What the shaders know of the viewpoint.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ViewUniform {
    pub(super) clip_from_scene: [[f32; 4]; 4],
    /// Direction to the eye.
    pub(super) towards: [f32; 4],
    pub(super) size_px: [f32; 2],
    pub(super) px_per_point: f32,
    /// Seconds, as in births.
    pub(super) time: f32,
    /// Seconds that a new station takes to appear.
    pub(super) fade: f32,
    /// Nearest visible distance, mm.
    pub(super) near: f32,
    pub(super) unused: [f32; 2],
}

/// One frame of a 3D view, handed to the graphics card.
pub(super) struct Frame {
    /// Which view it is; each has a picture of its own.
    pub(super) view: u64,
    /// Where on the window, screen points.
    pub(super) rect: Rect,
    /// Without the size, which only the card's side knows to the pixel.
    pub(super) uniform: ViewUniform,
    pub(super) background: Color32,
    pub(super) scene: Arc<Layer>,
    pub(super) highlight: Arc<Layer>,
}

/// Makes the pipelines; once, before the first frame.
pub(super) fn install(state: &RenderState) {
    let card = Card {
        pipelines: Pipelines::new(&state.device, state.target_format),
        views: BTreeMap::new(),
    };
    state.renderer.write().callback_resources.insert(card);
}

struct Card {
    pipelines: Pipelines,
    views: BTreeMap<u64, View>,
}

/// A layer on the card.
struct Loaded {
    /// Held, so that no other layer can get its address.
    layer: Arc<Layer>,
    points: Option<wgpu::Buffer>,
    lines: Option<wgpu::Buffer>,
    ellipsoids: Option<wgpu::Buffer>,
}

impl Loaded {
    fn new(device: &wgpu::Device, layer: &Arc<Layer>) -> Self {
        let load = |contents: &[u8]| {
            let usage = wgpu::BufferUsages::VERTEX;
            (!contents.is_empty()).then(|| {
                device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: None,
                    contents,
                    usage,
                })
            })
        };
        Self {
            layer: Arc::clone(layer),
            points: load(bytemuck::cast_slice(&layer.points)),
            lines: load(bytemuck::cast_slice(&layer.lines)),
            ellipsoids: load(bytemuck::cast_slice(&layer.ellipsoids)),
        }
    }

    /// Loads another layer, unless it is the same.
    fn update(&mut self, device: &wgpu::Device, layer: &Arc<Layer>) -> Freshness {
        if Arc::ptr_eq(&self.layer, layer) {
            return Freshness::Same;
        }
        *self = Self::new(device, layer);
        Freshness::Changed
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Freshness {
    Same,
    Changed,
}

/// The pictures of one view, all of one size.
struct Pictures {
    size: [u32; 2],
    samples: wgpu::TextureView,
    depth: wgpu::TextureView,
    resolved: wgpu::TextureView,
    blit: wgpu::BindGroup,
}

impl Pictures {
    fn new(device: &wgpu::Device, pipelines: &Pipelines, size: [u32; 2]) -> Self {
        let picture = |format, sample_count, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("3D view"),
                size: wgpu::Extent3d {
                    width: size[0],
                    height: size[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let resolved = picture(
            Pipelines::COLOUR,
            1,
            drawn | wgpu::TextureUsages::TEXTURE_BINDING,
        );
        Self {
            size,
            samples: picture(Pipelines::COLOUR, SAMPLES, drawn),
            depth: picture(Pipelines::DEPTH, SAMPLES, drawn),
            blit: pipelines.bind_picture(device, &resolved),
            resolved,
        }
    }
}

/// What the card holds for one view.
struct View {
    scene: Loaded,
    highlight: Loaded,
    pictures: Pictures,
    uniform: wgpu::Buffer,
    bound_uniform: wgpu::BindGroup,
    /// What the picture shows.
    drawn: Option<(ViewUniform, Color32)>,
}

impl View {
    fn new(device: &wgpu::Device, pipelines: &Pipelines, frame: &Frame, size: [u32; 2]) -> Self {
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("3D view"),
            size: size_of::<ViewUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self {
            scene: Loaded::new(device, &frame.scene),
            highlight: Loaded::new(device, &frame.highlight),
            pictures: Pictures::new(device, pipelines, size),
            bound_uniform: pipelines.bind_uniform(device, &uniform),
            uniform,
            drawn: None,
        }
    }

    fn draw(&self, pipelines: &Pipelines, background: Color32, encoder: &mut wgpu::CommandEncoder) {
        let [r, g, b, _] = background
            .to_array()
            .map(|channel| f64::from(channel) / 255.0);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("3D view"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.pictures.samples,
                depth_slice: None,
                resolve_target: Some(&self.pictures.resolved),
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 }),
                    store: wgpu::StoreOp::Discard,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.pictures.depth,
                // Reversed: infinitely far away is 0.
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_bind_group(0, &self.bound_uniform, &[]);
        if let Some(instances) = &self.scene.ellipsoids {
            let count = self.scene.layer.ellipsoids.len() as u32;
            let sphere = pipelines.sphere_for(count);
            pass.set_pipeline(&pipelines.ellipsoids);
            pass.set_vertex_buffer(0, sphere.corners.slice(..));
            pass.set_vertex_buffer(1, instances.slice(..));
            pass.set_index_buffer(sphere.triangles.slice(..), wgpu::IndexFormat::Uint16);
            pass.draw_indexed(0..sphere.count, 0, 0..count);
        }
        let mut quads =
            |pipeline: &wgpu::RenderPipeline, instances: &Option<wgpu::Buffer>, count: usize| {
                if let Some(instances) = instances {
                    pass.set_pipeline(pipeline);
                    pass.set_vertex_buffer(0, instances.slice(..));
                    pass.draw(0..4, 0..count as u32);
                }
            };
        quads(
            &pipelines.points,
            &self.scene.points,
            self.scene.layer.points.len(),
        );
        for loaded in [&self.scene, &self.highlight] {
            quads(&pipelines.lines, &loaded.lines, loaded.layer.lines.len());
        }
        quads(
            &pipelines.points_on_top,
            &self.highlight.points,
            self.highlight.layer.points.len(),
        );
    }
}

/// The size of the view on the window, pixels; `None` where nothing of it can be drawn.
fn size_in_pixels(
    frame: &Frame,
    device: &wgpu::Device,
    screen: &ScreenDescriptor,
) -> Option<[u32; 2]> {
    let viewport = PaintCallbackInfo {
        viewport: frame.rect,
        clip_rect: frame.rect,
        pixels_per_point: screen.pixels_per_point,
        screen_size_px: screen.size_in_pixels,
    }
    .viewport_in_pixels();
    let largest = device.limits().max_texture_dimension_2d;
    let size =
        [viewport.width_px, viewport.height_px].map(|side| (side.max(0) as u32).min(largest));
    (size[0] > 0 && size[1] > 0).then_some(size)
}

impl CallbackTrait for Frame {
    fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        screen: &ScreenDescriptor,
        encoder: &mut wgpu::CommandEncoder,
        resources: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        let Some(Card { pipelines, views }) = resources.get_mut::<Card>() else {
            return Vec::new();
        };
        let Some(size) = size_in_pixels(self, device, screen) else {
            return Vec::new();
        };
        let view = views
            .entry(self.view)
            .or_insert_with(|| View::new(device, pipelines, self, size));
        if view.pictures.size != size {
            view.pictures = Pictures::new(device, pipelines, size);
            view.drawn = None;
        }
        let freshness = [
            view.scene.update(device, &self.scene),
            view.highlight.update(device, &self.highlight),
        ];
        let uniform = ViewUniform {
            size_px: size.map(|side| side as f32),
            px_per_point: screen.pixels_per_point,
            ..self.uniform
        };
        if freshness.contains(&Freshness::Changed) || view.drawn != Some((uniform, self.background))
        {
            queue.write_buffer(&view.uniform, 0, bytemuck::bytes_of(&uniform));
            view.draw(pipelines, self.background, encoder);
            view.drawn = Some((uniform, self.background));
        }
        Vec::new()
    }

    fn paint(
        &self,
        _: PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        resources: &CallbackResources,
    ) {
        let Some(card) = resources.get::<Card>() else {
            return;
        };
        let Some(view) = card.views.get(&self.view) else {
            return;
        };
        pass.set_pipeline(&card.pipelines.blit);
        pass.set_bind_group(0, &view.pictures.blit, &[]);
        pass.draw(0..4, 0..1);
    }
}

impl Frame {
    /// As a shape among egui's.
    pub(super) fn shape(self) -> egui::Shape {
        let rect = self.rect;
        egui_wgpu::Callback::new_paint_callback(rect, self).into()
    }
}
