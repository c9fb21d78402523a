//! A plane target seen obliquely from near.

use nalgebra::{Matrix3, Rotation3, SVector, Vector2, Vector3};

/// From the target's plane (y up, units of the dot's radius) to pixels, and back.
#[derive(Clone, Copy)]
pub(crate) struct PlaneView {
    to_px: Matrix3<f64>,
    from_px: Matrix3<f64>,
    middle: Vector2<f64>,
    /// What the lens does inside the target: the change of scale along this direction, px^-1.
    bend: Vector2<f64>,
}

impl PlaneView {
    /// `radius` px where the target is seen at scale, its plane tilted by `incidence` about the direction `along` after a
    /// turn by `turn` (counter-clockwise as seen), from `distance` radii away.
    pub(crate) fn new(
        middle: Vector2<f64>,
        radius: f64,
        [turn, incidence, along]: [f64; 3],
        distance: f64,
    ) -> Self {
        let about_z = |angle: f64| Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
        let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), incidence);
        let mut pose = (about_z(along) * tilt * about_z(turn - along)).into_inner();
        pose.set_column(2, &Vector3::new(0.0, 0.0, -distance));
        // Rows of the picture run downwards, the camera looks along -z.
        let scale = radius * distance;
        #[rustfmt::skip]
        let to_image = Matrix3::new(
            -scale, 0.0, middle.x,
            0.0, scale, middle.y,
            0.0, 0.0, 1.0,
        );
        let to_px = to_image * pose;
        Self {
            to_px,
            from_px: to_px
                .try_inverse()
                .expect("the camera stands off the plane"),
            middle,
            bend: Vector2::zeros(),
        }
    }

    /// The same under a lens whose scale changes by `bend` px^-1.
    pub(crate) fn bent(mut self, bend: Vector2<f64>) -> Self {
        self.bend = bend;
        self
    }

    /// The same with the plane before it moved, stretched and tilted by a little: the first eight elements, row by row, of what is
    /// added to the unit matrix.
    pub(crate) fn moved(mut self, by: &SVector<f64, 8>) -> Self {
        let elements = by.iter().copied().chain([0.0]);
        let motion = Matrix3::identity() + Matrix3::from_row_iterator(elements);
        self.from_px = motion * self.from_px;
        self.to_px = self
            .from_px
            .try_inverse()
            .expect("a little motion leaves a plane");
        self
    }

    /// The place on the plane of a pixel.
    pub(crate) fn plane(&self, px: Vector2<f64>) -> Vector2<f64> {
        let off = px - self.middle;
        let straight = self.middle + off * (1.0 + self.bend.dot(&off));
        let plane = self.from_px * straight.push(1.0);
        plane.xy() / plane.z
    }

    /// Where a place of the plane is seen, without the lens.
    pub(crate) fn px(&self, plane: Vector2<f64>) -> Vector2<f64> {
        let px = self.to_px * plane.push(1.0);
        px.xy() / px.z
    }
}
