//! The viewpoint: an orbit round a target, in the world's `f64` millimetres.

use egui::Pos2;
use egui::Rect;
use egui::Vec2;
use glam::DMat4;
use glam::DQuat;
use glam::DVec2;
use glam::DVec3;
use glam::Mat4;

/// Half of the vertical field of view: 20 degrees show depth without stretching the rim.
const HALF_FIELD_RAD: f64 = 0.35;
/// Nearest visible place as a part of the distance to the target; reversed depth keeps its digits.
const NEAR_PART: f64 = 1e-3;
/// Part of the canvas that a fit fills; the rest is for names at the rim.
const FIT_PART: f64 = 0.88;
/// A turn for each screen point of dragging, radians: a canvas of 600 points is a full turn.
const TURN_PER_POINT: f64 = 0.01;
/// Nearest and farthest distance from the target, mm; beyond, numbers lose their meaning.
const DISTANCE_MM: [f64; 2] = [1e-3, 1e9];

/// A direction to look from, by the axes of the network's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StandardView {
    /// From above: x to the right, y up.
    Top,
    /// From the front: x to the right, z up.
    Front,
    /// From the right: y to the right, z up.
    Side,
    /// From above, in front and to the right.
    Oblique,
}

impl StandardView {
    /// All of them, in the order of the buttons.
    pub const ALL: [Self; 4] = [Self::Top, Self::Front, Self::Side, Self::Oblique];

    /// Text of its button.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Top => "Top",
            Self::Front => "Front",
            Self::Side => "Side",
            Self::Oblique => "Oblique",
        }
    }

    /// Which axes it shows, for the button's hint.
    #[must_use]
    pub fn hint(self) -> &'static str {
        match self {
            Self::Top => "From above: x to the right, y up",
            Self::Front => "From the front: x to the right, z up",
            Self::Side => "From the right: y to the right, z up",
            Self::Oblique => "From above, in front and to the right",
        }
    }

    fn world_from_view(self) -> DQuat {
        let upright = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        match self {
            Self::Top => DQuat::IDENTITY,
            Self::Front => upright,
            Self::Side => DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2) * upright,
            Self::Oblique => DQuat::from_rotation_z(0.5) * upright * DQuat::from_rotation_x(-0.5),
        }
    }
}

/// A viewpoint. View frame: x right, y up, z towards the viewer, as in a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbitCamera {
    /// The place that stays in the middle of the canvas, mm.
    pub target: DVec3,
    /// From the eye to the target, mm.
    pub distance: f64,
    /// Turns view directions into the world.
    pub world_from_view: DQuat,
}

impl Default for OrbitCamera {
    fn default() -> Self {
        Self {
            target: DVec3::ZERO,
            distance: 1000.0,
            world_from_view: StandardView::Oblique.world_from_view(),
        }
    }
}

/// A place on the canvas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// Screen points.
    pub position: Pos2,
    /// Distance from the eye along the view, mm.
    pub depth: f64,
}

/// A viewpoint with its canvas, ready to project many places.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    towards: DVec3,
    near: f64,
    /// Screen points for a slope of one.
    scale: f64,
    centre: DVec2,
}

impl Projector {
    /// A place of the world (mm) on the canvas; `None` where it is behind the eye or not a number.
    #[must_use]
    pub fn project(&self, place: DVec3) -> Option<Projected> {
        let from_eye = place - self.eye;
        let depth = -from_eye.dot(self.towards);
        if !depth.is_finite() || depth < self.near {
            return None;
        }
        let slope = DVec2::new(from_eye.dot(self.right), -from_eye.dot(self.up)) / depth;
        let position = self.centre + slope * self.scale;
        Some(Projected {
            position: Pos2::new(position.x as f32, position.y as f32),
            depth,
        })
    }

    /// The place of the world, mm, that is seen at a screen point at this depth, mm.
    #[must_use]
    pub fn unproject(&self, position: Pos2, depth: f64) -> DVec3 {
        let offset = (DVec2::new(position.x.into(), position.y.into()) - self.centre) / self.scale;
        self.eye + (self.right * offset.x - self.up * offset.y - self.towards) * depth
    }

    /// Length in the world, mm, of one screen point at this depth, mm.
    #[must_use]
    pub fn mm_per_point(&self, depth: f64) -> f64 {
        depth / self.scale
    }
}

impl OrbitCamera {
    /// The projection onto a canvas.
    #[must_use]
    pub fn projector(&self, canvas: Rect) -> Projector {
        let towards = self.world_from_view * DVec3::Z;
        Projector {
            eye: self.target + towards * self.distance,
            right: self.world_from_view * DVec3::X,
            up: self.world_from_view * DVec3::Y,
            towards,
            near: self.near(),
            scale: f64::from(canvas.height().max(1.0)) / 2.0 / HALF_FIELD_RAD.tan(),
            centre: DVec2::new(canvas.center().x.into(), canvas.center().y.into()),
        }
    }

    /// Nearest visible distance from the eye, mm.
    #[must_use]
    pub fn near(&self) -> f64 {
        self.distance * NEAR_PART
    }

    /// Clip coordinates (depth from 1 near to 0 far away) from coordinates relative to `origin`, mm; the large numbers
    /// cancel in `f64` before the result becomes `f32`.
    #[must_use]
    pub fn clip_from_scene(&self, origin: DVec3, canvas: Rect) -> Mat4 {
        let aspect = f64::from(canvas.width().max(1.0) / canvas.height().max(1.0));
        let near = self.near();
        let height = 1.0 / HALF_FIELD_RAD.tan();
        let clip_from_view = DMat4::from_cols_array_2d(&[
            [height / aspect, 0.0, 0.0, 0.0],
            [0.0, height, 0.0, 0.0],
            [0.0, 0.0, 0.0, -1.0],
            [0.0, 0.0, near, 0.0],
        ]);
        let view_from_world = self.world_from_view.inverse();
        let eye = self.target - origin + self.towards() * self.distance;
        let view_from_scene =
            DMat4::from_rotation_translation(view_from_world, view_from_world * -eye);
        (clip_from_view * view_from_scene).as_mat4()
    }

    /// Direction from the target to the eye.
    #[must_use]
    pub fn towards(&self) -> DVec3 {
        self.world_from_view * DVec3::Z
    }

    /// Turns the scene with the pointer, round the target: sideways about the world's z, up and down about the view's x.
    pub fn orbit(&mut self, drag: Vec2) {
        // Upside down, a drag to the right would turn the near side to the left.
        let sign = if (self.world_from_view * DVec3::Y).z < 0.0 {
            -1.0
        } else {
            1.0
        };
        let about_z = DQuat::from_rotation_z(-sign * f64::from(drag.x) * TURN_PER_POINT);
        let about_x = DQuat::from_rotation_x(-f64::from(drag.y) * TURN_PER_POINT);
        self.world_from_view = (about_z * self.world_from_view * about_x).normalize();
    }

    /// Turns the view about its own axis; for networks whose z is not up.
    pub fn roll(&mut self, drag: Vec2) {
        let turn = DQuat::from_rotation_z(f64::from(drag.x) * TURN_PER_POINT);
        self.world_from_view = (self.world_from_view * turn).normalize();
    }

    /// Shifts the scene with the pointer, at the target's depth.
    pub fn pan(&mut self, drag: Vec2, canvas: Rect) {
        let mm = self.projector(canvas).mm_per_point(self.distance);
        let shift = DVec3::new(-f64::from(drag.x), f64::from(drag.y), 0.0) * mm;
        self.target += self.world_from_view * shift;
    }

    /// Moves towards `anchor` (factor below 1) or away; whatever is seen in the anchor's direction stays under the
    /// pointer.
    pub fn zoom(&mut self, anchor: DVec3, factor: f64) {
        let [nearest, farthest] = DISTANCE_MM;
        let distance = (self.distance * factor).clamp(nearest, farthest);
        let factor = distance / self.distance;
        self.target = anchor + (self.target - anchor) * factor;
        self.distance = distance;
    }

    /// Looks from a standard direction; target and distance stay.
    pub fn turn_to(&mut self, view: StandardView) {
        self.world_from_view = view.world_from_view();
    }

    /// Shows all places (mm), as large as the canvas allows, from the present direction. Changes nothing where there are
    /// none.
    pub fn fit(&mut self, places: impl Iterator<Item = DVec3> + Clone, canvas: Rect) {
        let view_from_world = self.world_from_view.inverse();
        let in_view = places
            .filter(|place| place.is_finite())
            .map(|place| view_from_world * place);
        let Some((low, high)) =
            in_view
                .clone()
                .fold(None, |bounds: Option<(DVec3, DVec3)>, place| {
                    let (low, high) = bounds.unwrap_or((place, place));
                    Some((low.min(place), high.max(place)))
                })
        else {
            return;
        };
        let centre = (low + high) / 2.0;
        let aspect = f64::from(canvas.width().max(1.0) / canvas.height().max(1.0));
        let slope_y = HALF_FIELD_RAD.tan() * FIT_PART;
        let slope_x = slope_y * aspect;
        let needed = in_view.fold(0.0, |needed: f64, place| {
            let from_centre = place - centre;
            let sideways = (from_centre.x.abs() / slope_x).max(from_centre.y.abs() / slope_y);
            // A place straight ahead must not touch the eye.
            needed
                .max(sideways + from_centre.z)
                .max(1.2 * from_centre.z)
        });
        self.target = self.world_from_view * centre;
        // A single place has no size: show 100 mm round it.
        self.distance = if needed > 1e-6 { needed } else { 300.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn canvas() -> Rect {
        Rect::from_min_size(Pos2::new(100.0, 50.0), Vec2::new(800.0, 500.0))
    }

    fn any_camera() -> impl Strategy<Value = OrbitCamera> {
        (
            prop::array::uniform3(-1e4..1e4),
            10.0..1e4,
            -800.0f32..800.0,
            -300.0f32..300.0,
        )
            .prop_map(|(target, distance, x, y)| {
                let mut camera = OrbitCamera {
                    target: DVec3::from(target),
                    distance,
                    ..Default::default()
                };
                camera.orbit(Vec2::new(x, y));
                camera
            })
    }

    /// Screen points are `f32`: at 1000 they hold four digits behind the point.
    const SCREEN: f32 = 2e-3;

    proptest! {
        #[test]
        fn a_place_comes_back(camera in any_camera(), x in 0.0f32..1000.0, y in 0.0f32..600.0, part in 0.1..10.0) {
            let projector = camera.projector(canvas());
            let depth = part * camera.distance;
            let projected = projector.project(projector.unproject(Pos2::new(x, y), depth)).unwrap();
            prop_assert!((projected.position - Pos2::new(x, y)).length() < SCREEN);
            prop_assert!((projected.depth / depth - 1.0).abs() < 1e-6);
        }

        #[test]
        fn zoom_keeps_what_is_under_the_pointer(
            camera in any_camera(), x in 0.0f32..1000.0, y in 0.0f32..600.0, part in 0.3..3.0, factor in 0.5..2.0,
        ) {
            let pointer = Pos2::new(x, y);
            let anchor = camera.projector(canvas()).unproject(pointer, part * camera.distance);
            let mut zoomed = camera;
            zoomed.zoom(anchor, factor);
            prop_assert!((zoomed.distance / camera.distance - factor).abs() < 1e-9);
            let after = zoomed.projector(canvas()).project(anchor).unwrap();
            prop_assert!((after.position - pointer).length() < SCREEN);
        }

        #[test]
        fn fit_shows_all(
            mut camera in any_camera(),
            places in prop::collection::vec(prop::array::uniform3(-5e3..5e3), 2..30),
        ) {
            camera.fit(places.iter().copied().map(DVec3::from), canvas());
            let projector = camera.projector(canvas());
            for place in places {
                let projected = projector.project(DVec3::from(place)).unwrap();
                prop_assert!(canvas().contains(projected.position));
            }
        }

        #[test]
        fn the_graphics_card_sees_what_the_pointer_sees(camera in any_camera(), x in -0.3..0.3, y in -0.3..0.3) {
            let origin = camera.target + DVec3::splat(10.0);
            let place = camera.target + DVec3::new(x, y, x * y) * camera.distance;
            let clip = camera.clip_from_scene(origin, canvas()) * (place - origin).as_vec3().extend(1.0);
            let screen = canvas().center()
                + Vec2::new(clip.x / clip.w, -clip.y / clip.w) * canvas().size() / 2.0;
            let projected = camera.projector(canvas()).project(place).unwrap();
            // Coordinates in single precision.
            prop_assert!((screen - projected.position).length() < 0.05);
            prop_assert!(clip.z / clip.w > 0.0 && clip.z / clip.w < 1.0);
        }

        #[test]
        fn pan_takes_the_target_along(mut camera in any_camera(), x in -200.0f32..200.0, y in -200.0f32..200.0) {
            let target = camera.target;
            camera.pan(Vec2::new(x, y), canvas());
            let projected = camera.projector(canvas()).project(target).unwrap();
            prop_assert!((projected.position - (canvas().center() + Vec2::new(x, y))).length() < SCREEN);
        }
    }

    #[test]
    fn standard_views_show_their_axes() {
        let seen = |view, axis: DVec3| {
            let mut camera = OrbitCamera::default();
            camera.turn_to(view);
            camera
                .projector(canvas())
                .project(axis * 100.0)
                .unwrap()
                .position
                - canvas().center()
        };
        for (view, right, up) in [
            (StandardView::Top, DVec3::X, DVec3::Y),
            (StandardView::Front, DVec3::X, DVec3::Z),
            (StandardView::Side, DVec3::Y, DVec3::Z),
        ] {
            assert!(
                seen(view, right).x > 10.0 && seen(view, right).y.abs() < 0.1,
                "{view:?}"
            );
            assert!(
                seen(view, up).y < -10.0 && seen(view, up).x.abs() < 0.1,
                "{view:?}"
            );
        }
        assert!(seen(StandardView::Oblique, DVec3::Z).y < -10.0);
    }

    #[test]
    fn what_is_behind_the_eye_is_not_seen() {
        let camera = OrbitCamera::default();
        let behind = camera.target + camera.towards() * (2.0 * camera.distance);
        assert_eq!(camera.projector(canvas()).project(behind), None);
        assert_eq!(camera.projector(canvas()).project(DVec3::NAN), None);
    }

    #[test]
    fn fit_of_nothing_changes_nothing() {
        let mut camera = OrbitCamera::default();
        camera.fit(std::iter::empty(), canvas());
        assert_eq!(camera, OrbitCamera::default());
        camera.fit([DVec3::NAN].into_iter(), canvas());
        assert_eq!(camera, OrbitCamera::default());
    }
}
