//! Where every dot is imaged, how large, and how much of it is seen.

use nalgebra::{Matrix2, SymmetricEigen, Vector2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::scene::Disc;
use super::surface::{Occluder, occluders};
use super::{Placement, Scene};
use crate::camera::Camera;
use crate::geometry::Pose;

/// Points on a dot's boundary; a polygon of 64 gives the centroid of a perspective, distorted circle to 1e-5 px.
const BOUNDARY_POINTS: usize = 64;
/// Rings of sample points inside a dot that tell the visible share of a partly hidden one.
const SHARE_RINGS: usize = 16;

/// How much of a dot a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Visibility {
    /// All of it.
    Whole,
    /// This share of its area; the rest is hidden or beyond the frame.
    Part(f64),
    /// Nothing: something stands before it.
    Hidden,
    /// Nothing: it is imaged beside the frame or lies behind the camera.
    OutsideFrame,
    /// Nothing: its face is turned away from the camera.
    FacingAway,
}

/// A dot as a picture ought to show it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthDot {
    /// Label of the dot.
    pub label: String,
    /// Image of the dot's centre, px; `None` where the lens does not image it.
    pub image_of_centre_px: Option<Vector2<f64>>,
    /// Centre of area of the whole dot's image, px, whatever hides it; `None` where it has none or is turned away.
    pub centre_of_image_px: Option<Vector2<f64>>,
    /// Larger full diameter of the image (from its second moments), px; 0 without an image.
    pub major_px: f64,
    /// Smaller full diameter of the image, px; 0 without an image.
    pub minor_px: f64,
    /// Angle between the dot's normal and the ray to the camera, degrees.
    pub incidence_deg: f64,
    /// How much of it is seen.
    pub visibility: Visibility,
    /// Least distance from this dot's edge to the edge of another dot or of another code's ring in the picture, px;
    /// negative where they overlap, `None` for a dot that is not seen or stands alone.
    pub near_px: Option<f64>,
}

impl TruthDot {
    /// Whether all of the dot is seen.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.visibility == Visibility::Whole
    }

    /// Whether some of the dot is seen.
    #[must_use]
    pub fn is_seen(&self) -> bool {
        matches!(self.visibility, Visibility::Whole | Visibility::Part(_))
    }
}

/// The truth of one picture: a dot for every dot of the scene, in the scene's order.
#[must_use]
pub fn truth_dots(scene: &Scene, camera: &Camera, pose: &Pose) -> Vec<TruthDot> {
    views(scene, camera, pose, &occluders(&scene.surfaces))
        .into_iter()
        .map(|view| view.truth)
        .collect()
}

/// A dot's truth with the outline of its image, empty where it has none.
pub(super) struct View {
    pub(super) truth: TruthDot,
    outline: Vec<Vector2<f64>>,
    /// Outline that other dots must keep away from: the ring's where the dot has one.
    outer: Vec<Vector2<f64>>,
    /// Farthest point of `outer` from the centre of the dot's image, px.
    outer_reach: f64,
}

/// What the camera makes of all dots.
pub(super) fn views(
    scene: &Scene,
    camera: &Camera,
    pose: &Pose,
    occluders: &[Occluder],
) -> Vec<View> {
    let mut views: Vec<View> = scene
        .discs
        .par_iter()
        .map(|disc| view(disc, scene, camera, pose, occluders))
        .collect();
    let near: Vec<Option<f64>> = (0..views.len())
        .into_par_iter()
        .map(|index| nearest_edge(&views, index))
        .collect();
    for (view, near) in views.iter_mut().zip(near) {
        view.truth.near_px = near;
    }
    views
}

fn view(disc: &Disc, scene: &Scene, camera: &Camera, pose: &Pose, occluders: &[Occluder]) -> View {
    let to_camera = pose.centre_in_world - disc.placement.origin;
    let cos_incidence = disc.placement.normal().dot(&to_camera) / to_camera.norm();
    let mut truth = TruthDot {
        label: disc.label.clone(),
        image_of_centre_px: camera.project(&pose.camera_from_point(&disc.placement.origin)),
        centre_of_image_px: None,
        major_px: 0.0,
        minor_px: 0.0,
        incidence_deg: cos_incidence.clamp(-1.0, 1.0).acos().to_degrees(),
        visibility: Visibility::OutsideFrame,
        near_px: None,
    };
    let (mut outline, mut outer) = (Vec::new(), Vec::new());
    if cos_incidence <= 0.0 {
        truth.visibility = Visibility::FacingAway;
    } else if let Some(image) = outline_of(&disc.placement, disc.radius, camera, pose) {
        let area = AreaMoments::of(&image);
        truth.centre_of_image_px = Some(area.centre);
        truth.major_px = area.major;
        truth.minor_px = area.minor;
        truth.visibility = visibility(disc, &image, camera, pose, occluders);
        outer = scene
            .rings
            .iter()
            .find(|ring| ring.label == disc.label)
            .and_then(|ring| outline_of(&ring.placement, 3.0 * ring.dot_radius, camera, pose))
            .unwrap_or_else(|| image.clone());
        outline = image;
    }
    let centre = truth.centre_of_image_px.unwrap_or_default();
    View {
        outer_reach: reach(&outer, &centre),
        truth,
        outline,
        outer,
    }
}

/// The image of a circle's boundary, px; `None` where the lens does not image all of it.
pub(super) fn outline_of(
    placement: &Placement,
    radius: f64,
    camera: &Camera,
    pose: &Pose,
) -> Option<Vec<Vector2<f64>>> {
    (0..BOUNDARY_POINTS)
        .map(|k| {
            let point = on_circle(placement, radius, k as f64 / BOUNDARY_POINTS as f64);
            camera.project(&pose.camera_from_point(&point))
        })
        .collect()
}

fn on_circle(placement: &Placement, radius: f64, turn: f64) -> Vector3<f64> {
    let (sin, cos) = (turn * std::f64::consts::TAU).sin_cos();
    placement.point(radius * cos, radius * sin)
}

fn visibility(
    disc: &Disc,
    outline: &[Vector2<f64>],
    camera: &Camera,
    pose: &Pose,
    occluders: &[Occluder],
) -> Visibility {
    let eye = &pose.centre_in_world;
    let hidden = |point: &Vector3<f64>| occluders.iter().any(|o| o.hides(point, eye));
    let framed = outline.iter().filter(|px| camera.contains(px)).count();
    if framed == 0 {
        return Visibility::OutsideFrame;
    }
    // Every second boundary point: what hides less than the arc between two of them hides 0.01 % of the area.
    let covered = (0..BOUNDARY_POINTS / 2)
        .map(|k| {
            on_circle(
                &disc.placement,
                disc.radius,
                2.0 * k as f64 / BOUNDARY_POINTS as f64,
            )
        })
        .chain([disc.placement.origin])
        .filter(hidden)
        .count();
    if framed == outline.len() && covered == 0 {
        return Visibility::Whole;
    }
    let samples = area_samples(disc);
    let seen = samples
        .iter()
        .filter(|point| {
            !hidden(point)
                && camera
                    .project(&pose.camera_from_point(point))
                    .is_some_and(|px| camera.contains(&px))
        })
        .count();
    if seen == 0 {
        return Visibility::Hidden;
    }
    Visibility::Part(seen as f64 / samples.len() as f64)
}

/// Points that stand for equal shares of a dot's area.
fn area_samples(disc: &Disc) -> Vec<Vector3<f64>> {
    (0..SHARE_RINGS)
        .flat_map(|ring| {
            let count = 2 * ring + 1;
            let radius = disc.radius * (ring as f64 + 0.5) / SHARE_RINGS as f64;
            (0..3 * count).map(move |k| {
                on_circle(
                    &disc.placement,
                    radius,
                    (k as f64 + 0.5) / (3 * count) as f64,
                )
            })
        })
        .collect()
}

struct AreaMoments {
    centre: Vector2<f64>,
    major: f64,
    minor: f64,
}

impl AreaMoments {
    /// Centre of area and axes of the ellipse with the same second moments, from the outline by Green's theorem.
    fn of(outline: &[Vector2<f64>]) -> Self {
        // Moments about a point of the figure keep the digits that moments about the image corner would lose.
        let near = outline[0];
        let (mut area, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for k in 0..outline.len() {
            let (p, q) = (outline[k] - near, outline[(k + 1) % outline.len()] - near);
            let cross = p.perp(&q);
            let sum = p + q;
            area += cross / 2.0;
            first += sum * (cross / 6.0);
            second +=
                (p * p.transpose() + q * q.transpose() + sum * sum.transpose()) * (cross / 24.0);
        }
        let centre = first / area;
        let spread = SymmetricEigen::new(second / area - centre * centre.transpose()).eigenvalues;
        // A filled ellipse of semi-axis a has the variance a^2 / 4 along it.
        let diameters = spread.map(|variance| 4.0 * variance.max(0.0).sqrt());
        Self {
            centre: near + centre,
            major: diameters.max(),
            minor: diameters.min(),
        }
    }
}

/// Distance from the centre to the farthest point of an outline, px.
fn reach(outline: &[Vector2<f64>], centre: &Vector2<f64>) -> f64 {
    outline
        .iter()
        .map(|p| (p - centre).norm())
        .fold(0.0, f64::max)
}

fn nearest_edge(views: &[View], index: usize) -> Option<f64> {
    let own = &views[index];
    let centre = own.truth.centre_of_image_px?;
    if !own.truth.is_seen() {
        return None;
    }
    let own_reach = own.truth.major_px / 2.0;
    let mut others: Vec<(f64, &View, Vector2<f64>)> = views
        .iter()
        .enumerate()
        .filter(|(other, view)| *other != index && view.truth.is_seen())
        .filter_map(|(_, view)| {
            let place = view.truth.centre_of_image_px?;
            let least = (place - centre).norm() - own_reach - view.outer_reach - 1.0;
            Some((least, view, place))
        })
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut nearest: Option<f64> = None;
    for (least, other, place) in others {
        if nearest.is_some_and(|found| found <= least) {
            break;
        }
        let gap = gap(&own.outline, &centre, &other.outer, &place);
        nearest = Some(nearest.map_or(gap, |found| found.min(gap)));
    }
    nearest
}

/// Least distance of two outlines; negative, by how deep, where they overlap.
fn gap(
    a: &[Vector2<f64>],
    a_centre: &Vector2<f64>,
    b: &[Vector2<f64>],
    b_centre: &Vector2<f64>,
) -> f64 {
    let towards = (b_centre - a_centre)
        .try_normalize(1e-9)
        .unwrap_or_else(Vector2::x);
    let extent = |outline: &[Vector2<f64>], centre: &Vector2<f64>, side: f64| {
        outline
            .iter()
            .map(|p| side * (p - centre).dot(&towards))
            .fold(f64::MIN, f64::max)
    };
    let along = (b_centre - a_centre).norm() - extent(a, a_centre, 1.0) - extent(b, b_centre, -1.0);
    if along >= 0.0 {
        // Separated along the line of centres, so the boundaries' least distance is the gap.
        return a
            .iter()
            .flat_map(|p| b.iter().map(move |q| (p - q).norm()))
            .fold(f64::INFINITY, f64::min);
    }
    let inside = a.iter().any(|p| contains(b, p)) || b.iter().any(|q| contains(a, q));
    if inside {
        return along;
    }
    a.iter()
        .flat_map(|p| b.iter().map(move |q| (p - q).norm()))
        .fold(f64::INFINITY, f64::min)
}

/// Whether a convex outline contains a point.
fn contains(outline: &[Vector2<f64>], point: &Vector2<f64>) -> bool {
    let side = |k: usize| {
        let (p, q) = (outline[k], outline[(k + 1) % outline.len()]);
        (q - p).perp(&(point - p))
    };
    (0..outline.len()).all(|k| side(k) >= 0.0) || (0..outline.len()).all(|k| side(k) <= 0.0)
}
