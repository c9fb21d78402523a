//! What there is to see in a network, rebuilt only when the network or the options change.

use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;
use nalgebra::Matrix3;
use nalgebra::Vector2;
use nalgebra::Vector3;

use super::colour::ColourScale;
use super::colour::Palette;
use super::colour::shown_number;
use super::instances::EllipsoidInstance;
use super::instances::Layer;
use super::instances::LineInstance;
use super::instances::Marker;
use super::instances::PointInstance;
use super::instances::bytes;
use super::options::Colouring;
use super::options::DisplayOptions;
use super::options::Exaggeration;
use crate::network::BarRole;
use crate::network::ImageId;
use crate::network::Network;
use crate::network::Point;
use crate::network::PointId;
use crate::network::PointKind;

/// Diameter of a point, screen points.
const POINT_SIZE: f32 = 7.0;
/// Width of a frustum's edges, screen points.
const STATION_WIDTH: f32 = 1.2;
/// Length of a frustum as a part of the middle distance from the stations to the points.
const FRUSTUM_PART: f64 = 0.13;
/// Size that the middle ellipsoid gets by itself, as a part of the middle distance of the points from their centre.
const ELLIPSOID_PART: f64 = 0.06;
/// Birth of what is there from the beginning, s: before any clock starts, so that it does not fade in.
pub(super) const ALWAYS: f32 = -1e6;

/// A point that can be picked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ScenePoint {
    pub(super) id: PointId,
    pub(super) position: DVec3,
}

/// A station that can be picked.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SceneStation {
    pub(super) id: ImageId,
    pub(super) centre: DVec3,
    /// File name without folder and ending.
    pub(super) name: String,
    /// Corners of the picture: top left, top right, bottom right, bottom left.
    pub(super) corners: [DVec3; 4],
}

/// A scale bar between two measured points.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SceneBar {
    pub(super) middle: DVec3,
    /// Name and the length that it should have.
    pub(super) text: String,
}

/// What the scene was made from; as long as all of it is the same, the scene is the same.
#[derive(Clone)]
struct Basis {
    network: Network,
    options: DisplayOptions,
    theme: egui::Theme,
}

impl Basis {
    fn is_of(&self, network: &Network, options: &DisplayOptions, theme: egui::Theme) -> bool {
        let own = &self.network;
        Arc::ptr_eq(&own.points, &network.points)
            && Arc::ptr_eq(&own.images, &network.images)
            && Arc::ptr_eq(&own.cameras, &network.cameras)
            && Arc::ptr_eq(&own.scale_bars, &network.scale_bars)
            && Arc::ptr_eq(&own.device, &network.device)
            && Arc::ptr_eq(&own.names, &network.names)
            && Arc::ptr_eq(&own.settings, &network.settings)
            && Arc::ptr_eq(&own.control, &network.control)
            && Arc::ptr_eq(&own.connection_order, &network.connection_order)
            && self.options == *options
            && self.theme == theme
    }
}

/// What there is to see.
pub(super) struct Scene {
    basis: Basis,
    /// Place in the world that instances are relative to, mm.
    pub(super) origin: DVec3,
    pub(super) points: Vec<ScenePoint>,
    pub(super) stations: Vec<SceneStation>,
    pub(super) bars: Vec<SceneBar>,
    pub(super) layer: Arc<Layer>,
    /// Numbers of the colours; `None` where colours mean kinds or no number is known.
    pub(super) scale: Option<ColourScale>,
    /// Kinds of points present.
    pub(super) kinds: BTreeSet<PointKind>,
    /// Measured points with known coordinates.
    pub(super) control: usize,
    /// Points without the number that the colours show.
    pub(super) unknown: usize,
    /// How much the drawn ellipsoids are enlarged; `None` where none is drawn.
    pub(super) exaggeration: Option<f64>,
    pub(super) palette: Palette,
}

impl Scene {
    /// The scene of a network; `births` tells when stations began to fade in (s), others are there from the beginning.
    pub(super) fn new(
        network: &Network,
        options: &DisplayOptions,
        theme: egui::Theme,
        births: &BTreeMap<ImageId, f32>,
    ) -> Self {
        let points: Vec<(&PointId, &Point)> = network
            .points
            .iter()
            .map(|(id, point)| (id, point.as_ref()))
            .filter(|(_, point)| point.position.iter().all(|x| x.is_finite()))
            .collect();
        let origin = middle(points.iter().map(|(_, point)| dvec(&point.position)))
            .or_else(|| {
                middle(
                    network
                        .oriented_images()
                        .map(|(_, _, s)| dvec(&s.pose.centre_in_world)),
                )
            })
            .unwrap_or(DVec3::ZERO);
        let control: BTreeSet<PointId> = network
            .control
            .iter()
            .filter_map(|c| network.point_of_label(&c.label).ok())
            .collect();
        let mut scene = Self {
            basis: Basis {
                network: network.clone(),
                options: *options,
                theme,
            },
            origin,
            points: points
                .iter()
                .map(|(id, p)| ScenePoint {
                    id: **id,
                    position: dvec(&p.position),
                })
                .collect(),
            stations: stations(network, origin, options.station_size),
            bars: Vec::new(),
            layer: Arc::default(),
            scale: ColourScale::over(
                points
                    .iter()
                    .filter_map(|(_, p)| shown_number(options.colouring, p)),
            ),
            kinds: points.iter().map(|(id, _)| id.kind()).collect(),
            control: points.iter().filter(|(id, _)| control.contains(id)).count(),
            unknown: 0,
            exaggeration: None,
            palette: Palette::of(theme),
        };
        let mut layer = Layer::default();
        scene.draw_points(&points, &control, &mut layer);
        if options.stations.is_shown() {
            scene.draw_stations(births, &mut layer);
        }
        if options.scale_bars.is_shown() {
            scene.draw_bars(network, &mut layer);
        }
        if options.connection_order.is_shown() {
            scene.draw_order(network, births, &mut layer);
        }
        scene.layer = Arc::new(layer);
        scene
    }

    /// Whether this is still the scene of the network.
    pub(super) fn is_of(
        &self,
        network: &Network,
        options: &DisplayOptions,
        theme: egui::Theme,
    ) -> bool {
        self.basis.is_of(network, options, theme)
    }

    /// Whether there is nothing to see.
    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty() && self.stations.is_empty()
    }

    /// All places that a fit shows.
    pub(super) fn places(&self) -> impl Iterator<Item = DVec3> + Clone + '_ {
        let stations = self
            .stations
            .iter()
            .flat_map(|s| s.corners.into_iter().chain([s.centre]));
        self.points
            .iter()
            .map(|point| point.position)
            .chain(stations)
    }

    /// A point by its name.
    pub(super) fn point(&self, id: PointId) -> Option<&ScenePoint> {
        // Both the table and this list are in the order of the names.
        self.points
            .binary_search_by(|point| point.id.cmp(&id))
            .ok()
            .map(|place| &self.points[place])
    }

    /// How far a station that both scenes show has moved at most, mm.
    pub(super) fn moved(&self, before: &Scene) -> f64 {
        self.stations
            .iter()
            .filter_map(|now| Some((now.centre - before.station(now.id)?.centre).length()))
            .fold(0.0, f64::max)
    }

    /// A station by its image.
    pub(super) fn station(&self, id: ImageId) -> Option<&SceneStation> {
        self.stations
            .binary_search_by(|station| station.id.cmp(&id))
            .ok()
            .map(|place| &self.stations[place])
    }

    /// Coordinates as the graphics card gets them.
    pub(super) fn relative(&self, place: DVec3) -> [f32; 3] {
        (place - self.origin).as_vec3().to_array()
    }

    fn draw_points(
        &mut self,
        points: &[(&PointId, &Point)],
        control: &BTreeSet<PointId>,
        layer: &mut Layer,
    ) {
        let options = self.basis.options;
        if options.ellipsoids.is_shown()
            && points.iter().any(|(_, point)| point.covariance.is_some())
        {
            self.exaggeration = Some(match options.exaggeration {
                Exaggeration::Fixed(factor) => factor,
                Exaggeration::Automatic => automatic_exaggeration(points, self.origin),
            });
        }
        for (id, point) in points {
            let number = shown_number(options.colouring, point);
            let colour = match (options.colouring, number, self.scale) {
                (Colouring::Kind, ..) => self.palette.kind(id.kind()),
                (_, Some(number), Some(scale)) => scale.colour(number),
                _ => {
                    self.unknown += 1;
                    self.palette.neutral
                }
            };
            let marker = match id.kind() {
                _ if control.contains(id) => Marker::Triangle,
                PointKind::Cross => Marker::Diamond,
                PointKind::Code | PointKind::Target => Marker::Disc,
            };
            let position = self.relative(dvec(&point.position));
            layer.points.push(PointInstance {
                position,
                size: POINT_SIZE * if marker == Marker::Disc { 1.0 } else { 1.5 },
                colour: bytes(colour),
                // Half of the colour stays, so that many points side by side do not turn dark.
                rim: bytes(colour.lerp_to_gamma(self.palette.rim, 0.5)),
                marker: marker as u32,
            });
            let root = self
                .exaggeration
                .zip(point.covariance.as_ref().and_then(ellipsoid));
            if let Some((factor, root)) = root {
                let columns = std::array::from_fn(|c| {
                    std::array::from_fn(|r| (root[(r, c)] * factor) as f32)
                });
                layer.ellipsoids.push(EllipsoidInstance {
                    centre: position,
                    columns,
                    colour: bytes(colour),
                });
            }
        }
    }

    fn draw_stations(&self, births: &BTreeMap<ImageId, f32>, layer: &mut Layer) {
        for station in &self.stations {
            let birth = births.get(&station.id).copied().unwrap_or(ALWAYS);
            self.draw_frustum(
                station,
                bytes(self.palette.station),
                STATION_WIDTH,
                birth,
                layer,
            );
        }
    }

    /// Edges of a frustum, with a tent on the picture's upper edge that shows its roll.
    pub(super) fn draw_frustum(
        &self,
        station: &SceneStation,
        colour: [u8; 4],
        width: f32,
        birth: f32,
        layer: &mut Layer,
    ) {
        let [top_left, top_right, bottom_right, bottom_left] = station.corners;
        let up = (top_left - bottom_left) * 0.28;
        let (left, right) = (top_left.lerp(top_right, 0.3), top_left.lerp(top_right, 0.7));
        let tip = (top_left + top_right) / 2.0 + up;
        let edges = [
            [station.centre, top_left],
            [station.centre, top_right],
            [station.centre, bottom_right],
            [station.centre, bottom_left],
            [top_left, top_right],
            [top_right, bottom_right],
            [bottom_right, bottom_left],
            [bottom_left, top_left],
            [left, tip],
            [tip, right],
        ];
        layer
            .lines
            .extend(edges.into_iter().map(|[from, to]| LineInstance {
                from: self.relative(from),
                width,
                to: self.relative(to),
                birth,
                colour,
            }));
    }

    fn draw_bars(&mut self, network: &Network, layer: &mut Layer) {
        for bar in network.scale_bars.iter() {
            let end = |label: &str| {
                let id = network.point_of_label(label).ok()?;
                self.point(id).map(|point| point.position)
            };
            let (Some(from), Some(to)) = (end(&bar.from), end(&bar.to)) else {
                continue;
            };
            layer.lines.push(LineInstance {
                from: self.relative(from),
                width: if bar.role == BarRole::Control {
                    3.5
                } else {
                    2.0
                },
                to: self.relative(to),
                birth: ALWAYS,
                colour: bytes(self.palette.bar),
            });
            let role = if bar.role == BarRole::Check {
                " (check)"
            } else {
                ""
            };
            let length = network.bar_length_mm(bar);
            let text = format!("{} {length:.3} mm{role}", bar.name);
            self.bars.push(SceneBar {
                middle: (from + to) / 2.0,
                text,
            });
        }
    }

    fn draw_order(&self, network: &Network, births: &BTreeMap<ImageId, f32>, layer: &mut Layer) {
        let order: Vec<&SceneStation> = network
            .connection_order
            .iter()
            .filter_map(|id| self.station(*id))
            .collect();
        layer
            .lines
            .extend(order.windows(2).map(|pair| LineInstance {
                from: self.relative(pair[0].centre),
                width: 1.5,
                to: self.relative(pair[1].centre),
                birth: births.get(&pair[1].id).copied().unwrap_or(ALWAYS),
                colour: bytes(self.palette.order),
            }));
    }
}

/// A place in single steps from nalgebra to glam.
pub(super) fn dvec(v: &Vector3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// The middle of a box round all places that are numbers.
fn middle(places: impl Iterator<Item = DVec3>) -> Option<DVec3> {
    let bounds =
        places
            .filter(|place| place.is_finite())
            .fold(None, |bounds: Option<[DVec3; 2]>, place| {
                let [low, high] = bounds.unwrap_or([place; 2]);
                Some([low.min(place), high.max(place)])
            });
    bounds.map(|[low, high]| (low + high) / 2.0)
}

/// The middle one of some numbers.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// A matrix that takes the unit sphere to the ellipsoid of one sigma, mm: the Cholesky factor gives the same surface as
/// the principal axes. `None` where the covariance has no inside.
fn ellipsoid(covariance: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    covariance
        .cholesky()
        .map(|cholesky| cholesky.l())
        .filter(|root| root.iter().all(|x| x.is_finite()))
}

/// 1, 2 or 5 times a power of ten, the nearest below.
pub(super) fn round_number(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    let digit = value / power;
    power
        * if digit < 2.0 {
            1.0
        } else if digit < 5.0 {
            2.0
        } else {
            5.0
        }
}

fn automatic_exaggeration(points: &[(&PointId, &Point)], origin: DVec3) -> f64 {
    let sigma = median(
        points
            .iter()
            .filter_map(|(_, p)| shown_number(Colouring::Precision, p))
            .collect(),
    );
    let spread = median(
        points
            .iter()
            .map(|(_, p)| (dvec(&p.position) - origin).length())
            .collect(),
    );
    match (sigma, spread) {
        (Some(sigma), Some(spread)) if sigma > 0.0 && spread > 0.0 => {
            round_number(spread * ELLIPSOID_PART / sigma).max(1.0)
        }
        _ => 1.0,
    }
}

/// The oriented stations in the order of their images.
fn stations(network: &Network, origin: DVec3, size: f64) -> Vec<SceneStation> {
    let centres = network
        .oriented_images()
        .map(|(_, _, station)| dvec(&station.pose.centre_in_world));
    let length = median(centres.map(|centre| (centre - origin).length()).collect())
        .filter(|distance| *distance > 0.0)
        .map_or(100.0, |distance| distance * FRUSTUM_PART)
        * size;
    network
        .oriented_images()
        .filter(|(_, _, station)| station.pose.centre_in_world.iter().all(|x| x.is_finite()))
        .map(|(id, image, station)| {
            let camera = &network.camera_of(image).camera;
            let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
            let corners =
                [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[x, y]| {
                    // Straight edges: the lens's distortion has no place in a sketch.
                    let image = camera.image_from_pixel(&Vector2::new(x, y));
                    let c = camera.interior.principal_distance;
                    let direction = Vector3::new(image.x / c, image.y / c, -1.0) * length;
                    dvec(
                        &(station.pose.centre_in_world
                            + station.pose.world_from_direction(&direction)),
                    )
                });
            let file = image.file.path.rsplit('/').next().unwrap_or_default();
            let name = file
                .rsplit_once('.')
                .map_or(file, |(stem, _)| stem)
                .to_owned();
            SceneStation {
                id,
                centre: dvec(&station.pose.centre_in_world),
                name,
                corners,
            }
        })
        .collect()
}
