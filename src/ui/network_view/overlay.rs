//! Names, axes, the length scale and the counter: what is written over the picture.

use egui::Align2;
use egui::Color32;
use egui::FontId;
use egui::Pos2;
use egui::Rect;
use egui::Stroke;
use egui::Vec2;
use glam::DVec3;

use super::camera::OrbitCamera;
use super::options::DisplayOptions;
use super::picking::Target;
use super::scene::Scene;
use super::scene::round_number;
use crate::network::Network;
use crate::network::PointId;
use crate::ui::format;

/// Names on the canvas at most; more could not be read.
const MOST_NAMES: usize = 150;
/// Cells in which a name keeps others out, screen points.
const CELL: Vec2 = Vec2::new(14.0, 14.0);
/// Width of a letter of the font for names, screen points, for the estimate of the room that a name takes.
const LETTER: f32 = 6.4;
/// Longest length scale as a part of the canvas.
const SCALE_PART: f64 = 0.2;

fn font() -> FontId {
    FontId::proportional(12.0)
}

/// Where names stand already.
struct Room {
    canvas: Rect,
    columns: usize,
    taken: Vec<bool>,
}

impl Room {
    fn new(canvas: Rect) -> Self {
        let columns = (canvas.width() / CELL.x).ceil() as usize + 1;
        let rows = (canvas.height() / CELL.y).ceil() as usize + 1;
        Self {
            canvas,
            columns,
            taken: vec![false; columns * rows],
        }
    }

    /// Takes the room of a text that begins here; false where something stands there already or the canvas ends.
    fn take(&mut self, begin: Pos2, letters: usize) -> bool {
        if !self.canvas.contains(begin) {
            return false;
        }
        let place = (begin - self.canvas.min) / CELL;
        let start = place.y as usize * self.columns + place.x as usize;
        let cells = ((letters as f32 * LETTER / CELL.x).ceil() as usize)
            .clamp(1, self.columns - place.x as usize);
        let Some(taken) = self.taken.get_mut(start..start + cells) else {
            return false;
        };
        if taken.contains(&true) {
            return false;
        }
        taken.fill(true);
        true
    }
}

/// Writes the names that have room, the nearest first.
pub(super) fn draw_names(
    painter: &egui::Painter,
    canvas: Rect,
    scene: &Scene,
    network: &Network,
    options: &DisplayOptions,
    camera: &OrbitCamera,
    selected: Option<PointId>,
) {
    let projector = camera.projector(canvas);
    let mut room = Room::new(canvas);
    let mut left = MOST_NAMES;
    let mut write = |position: Pos2, text: &str, colour: Color32| {
        let begin = position + Vec2::new(8.0, -7.0);
        if left > 0 && room.take(begin, text.chars().count()) {
            left -= 1;
            painter.text(begin, Align2::LEFT_CENTER, text, font(), colour);
        }
    };
    if let Some(point) = selected.and_then(|id| scene.point(id))
        && let Some(seen) = projector.project(point.position)
    {
        write(
            seen.position + Vec2::new(6.0, -4.0),
            &network.label(point.id),
            scene.palette.text,
        );
    }
    if options.scale_bars.is_shown() {
        for bar in &scene.bars {
            if let Some(seen) = projector.project(bar.middle) {
                write(seen.position, &bar.text, scene.palette.bar);
            }
        }
    }
    if options.stations.is_shown() && options.station_names.is_shown() {
        for (position, place) in nearest(
            canvas,
            scene.stations.iter().map(|s| projector.project(s.centre)),
        ) {
            write(position, &scene.stations[place].name, scene.palette.station);
        }
    }
    if options.point_names.is_shown() {
        for (position, place) in nearest(
            canvas,
            scene.points.iter().map(|p| projector.project(p.position)),
        ) {
            write(
                position,
                &network.label(scene.points[place].id),
                scene.palette.text,
            );
        }
    }
}

/// Screen positions on the canvas with their places in the list, the nearest to the eye first.
fn nearest(
    canvas: Rect,
    projected: impl Iterator<Item = Option<super::camera::Projected>>,
) -> impl Iterator<Item = (Pos2, usize)> {
    let mut seen: Vec<(f64, Pos2, usize)> = projected
        .enumerate()
        .filter_map(|(place, seen)| seen.map(|seen| (seen.depth, seen.position, place)))
        .filter(|(_, position, _)| canvas.contains(*position))
        .collect();
    seen.sort_by(|a, b| a.0.total_cmp(&b.0));
    seen.into_iter()
        .map(|(_, position, place)| (position, place))
}

/// The axes of the network's frame, in the upper right corner.
pub(super) fn draw_axes(
    painter: &egui::Painter,
    canvas: Rect,
    scene: &Scene,
    camera: &OrbitCamera,
) {
    let at = canvas.right_top() + Vec2::new(-38.0, 38.0);
    let view_from_world = camera.world_from_view.inverse();
    let mut axes = [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)]
        .map(|(name, axis)| (name, view_from_world * axis));
    axes.sort_by(|a, b| a.1.z.total_cmp(&b.1.z));
    for (name, axis) in axes {
        let tip = at + Vec2::new(axis.x as f32, -axis.y as f32) * 22.0;
        let colour = scene
            .palette
            .text
            .gamma_multiply(if axis.z < -0.2 { 0.5 } else { 1.0 });
        painter.line_segment([at, tip], Stroke::new(1.5, colour));
        painter.text(
            at + (tip - at) * 1.35,
            Align2::CENTER_CENTER,
            name,
            font(),
            colour,
        );
    }
}

/// A length in the plane of the viewpoint's target, in the lower right corner.
pub(super) fn draw_length_scale(
    painter: &egui::Painter,
    canvas: Rect,
    scene: &Scene,
    camera: &OrbitCamera,
) {
    let mm_per_point = camera.projector(canvas).mm_per_point(camera.distance);
    let length = round_number(f64::from(canvas.width()) * SCALE_PART * mm_per_point);
    let points = (length / mm_per_point) as f32;
    let end = canvas.right_bottom() + Vec2::new(-12.0, -12.0);
    let begin = end - Vec2::new(points, 0.0);
    let (stroke, tick) = (Stroke::new(1.5, scene.palette.text), Vec2::new(0.0, 4.0));
    painter.line_segment([begin, end], stroke);
    painter.line_segment([begin - tick, begin + tick], stroke);
    painter.line_segment([end - tick, end + tick], stroke);
    let text = format!("{length} mm at the centre");
    painter.text(
        end - Vec2::new(0.0, 6.0),
        Align2::RIGHT_BOTTOM,
        text,
        font(),
        scene.palette.text,
    );
}

/// A few lines on a plate near the pointer, inside the canvas.
pub(super) fn draw_plate(
    painter: &egui::Painter,
    canvas: Rect,
    scene: &Scene,
    pointer: Pos2,
    text: String,
) {
    let galley = painter.layout_no_wrap(text, font(), scene.palette.text);
    let size = galley.size() + Vec2::splat(10.0);
    let most = (canvas.max - size).max(canvas.min);
    let min = (pointer + Vec2::new(14.0, 10.0)).clamp(canvas.min, most);
    let rect = Rect::from_min_size(min, size);
    painter.rect(
        rect,
        4.0,
        scene.palette.canvas.gamma_multiply(0.92),
        Stroke::new(1.0, scene.palette.station),
        egui::StrokeKind::Inside,
    );
    painter.galley(rect.min + Vec2::splat(5.0), galley, scene.palette.text);
}

/// What is known of something, for the plate and for screen readers.
pub(super) fn describe(network: &Network, target: Target) -> String {
    match target {
        Target::Point(id) => describe_point(network, id),
        Target::Station(id) => {
            let Some(entry) = network.images.get(&id) else {
                return String::new();
            };
            let Some(station) = &entry.station else {
                return entry.file.path.clone();
            };
            let sigmas = station
                .covariance
                .map(|c| [c[(3, 3)], c[(4, 4)], c[(5, 5)]].map(f64::sqrt));
            let used = entry.used_labels().count();
            let place = coordinates(station.pose.centre_in_world.into(), sigmas);
            format!("{}\n{place}\n{used} labelled dots used", entry.file.path)
        }
    }
}

fn describe_point(network: &Network, id: PointId) -> String {
    let Some(point) = network.points.get(&id) else {
        return network.label(id);
    };
    let sigmas = point
        .covariance
        .map(|c| [c[(0, 0)], c[(1, 1)], c[(2, 2)]].map(f64::sqrt));
    let place = coordinates(point.position.into(), sigmas);
    format!(
        "{} ({})\n{place}\n{} rays",
        network.label(id),
        id.kind(),
        point.rays
    )
}

fn coordinates(place: [f64; 3], sigmas: Option<[f64; 3]>) -> String {
    let lines = ["x", "y", "z"]
        .iter()
        .zip(place)
        .enumerate()
        .map(|(axis, (name, value))| {
            let sigma = sigmas.map(|sigmas| sigmas[axis]);
            let known = sigma.map_or_else(String::new, |sigma| {
                format!("  sigma {}", format::sigma(sigma, "mm"))
            });
            format!("{name} {}{known}", format::with_sigma(value, sigma, "mm"))
        });
    lines.collect::<Vec<_>>().join("\n")
}
