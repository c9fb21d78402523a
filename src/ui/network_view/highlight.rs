//! What the selection adds: a ring round the point, its rays, the station's frustum.

use std::collections::BTreeSet;
use std::sync::Arc;

use egui::Color32;

use super::instances::Layer;
use super::instances::LineInstance;
use super::instances::Marker;
use super::instances::PointInstance;
use super::instances::bytes;
use super::instances::faint;
use super::options::DisplayOptions;
use super::scene::ALWAYS;
use super::scene::Scene;
use crate::network::ImageId;
use crate::network::Network;
use crate::network::PointId;
use crate::ui::action::Selection;
use crate::ui::theme;

/// Diameter of the ring round the selected point, screen points.
const RING_SIZE: f32 = 20.0;
/// Opacity of rays, so that they do not hide what they cross.
const RAY_OPACITY: f32 = 0.75;

/// Diameter of the ring round a point of the group, screen points.
const GROUP_RING_SIZE: f32 = 13.0;

/// What the operator chose.
#[derive(Clone, Copy)]
pub(super) struct Chosen<'a> {
    pub(super) selection: &'a Selection,
    /// Points of the last box select.
    pub(super) group: &'a BTreeSet<PointId>,
}

/// What is drawn for the selection.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Highlight {
    pub(super) layer: Arc<Layer>,
    /// Rays that the adjustment uses.
    pub(super) used_rays: usize,
    /// Rays that were rejected.
    pub(super) rejected_rays: usize,
}

/// The colour of what is selected on this canvas: on a pale one the yellow of the theme needs more body.
pub(super) fn selected_colour(theme: egui::Theme) -> Color32 {
    match theme {
        egui::Theme::Dark => theme::SELECTED,
        egui::Theme::Light => theme::SELECTED.lerp_to_gamma(Color32::BLACK, 0.3),
    }
}

impl Highlight {
    /// What a selection adds to a scene.
    ///
    /// Cost: all labels of all oriented images; made only when the selection or the scene changes.
    pub(super) fn new(
        scene: &Scene,
        network: &Network,
        Chosen { selection, group }: Chosen<'_>,
        options: &DisplayOptions,
        theme: egui::Theme,
    ) -> Self {
        let mut highlight = Self::default();
        let mut layer = Layer::default();
        let selected = selected_colour(theme);
        for point in group.iter().filter_map(|id| scene.point(*id)) {
            layer.points.push(PointInstance {
                position: scene.relative(point.position),
                size: GROUP_RING_SIZE,
                colour: bytes(selected),
                rim: bytes(scene.palette.rim),
                marker: Marker::Ring as u32,
            });
        }
        if let Some(station) = selection.image.and_then(|id| scene.station(id)) {
            scene.draw_frustum(station, bytes(selected), 2.5, ALWAYS, &mut layer);
        }
        if let Some(point) = selection.point.and_then(|id| scene.point(id)) {
            let position = scene.relative(point.position);
            layer.points.push(PointInstance {
                position,
                size: RING_SIZE,
                colour: bytes(selected),
                rim: bytes(scene.palette.rim),
                marker: Marker::Ring as u32,
            });
            if options.rays.is_shown() {
                for ray in rays(network, point.id) {
                    let Some(station) = scene.station(ray.image) else {
                        continue;
                    };
                    let colour = match ray.standing {
                        Standing::Used => {
                            highlight.used_rays += 1;
                            selected
                        }
                        Standing::Rejected => {
                            highlight.rejected_rays += 1;
                            theme::REJECTED
                        }
                    };
                    layer.lines.push(LineInstance {
                        from: position,
                        width: if selection.image == Some(ray.image) {
                            3.0
                        } else {
                            1.3
                        },
                        to: scene.relative(station.centre),
                        birth: ALWAYS,
                        colour: faint(colour, RAY_OPACITY),
                    });
                }
            }
        }
        highlight.layer = Arc::new(layer);
        highlight
    }
}

/// Whether a ray is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    Used,
    Rejected,
}

/// A labelled dot of a point in an oriented image.
struct Ray {
    image: ImageId,
    standing: Standing,
}

fn rays(network: &Network, point: PointId) -> impl Iterator<Item = Ray> + '_ {
    network
        .oriented_images()
        .flat_map(move |(image, entry, _)| {
            entry
                .labels
                .values()
                .filter(move |label| label.point == point)
                .map(move |label| Ray {
                    image,
                    standing: if label.rejected.is_none() {
                        Standing::Used
                    } else {
                        Standing::Rejected
                    },
                })
        })
}
