//! Measuring where the operator points, fast enough for a frame: on a cut-out of the picture.

use nalgebra::Vector2;

use crate::imaging::GreyImage;
use crate::targets::{Dot, MeasureAtSettings, centre_by_hand, measure_at};
use crate::ui::format;

/// Half side of the cut-out, px: the surroundings that tell background and neighbours of a dot of 40 px.
const HALF_SIDE_PX: f64 = 48.0;

/// Half side in diameters of the neighbouring dots, where those are larger.
const HALF_SIDE_DIAMETERS: f64 = 1.5;

/// A dot that stands there already is nearer than this, px.
const SAME_DOT_PX: f64 = 1.0;

/// What is said where nothing can be fitted at a predicted place.
pub const NOTHING_THERE: &str = "Nothing measurable there";

/// A dot measured where somebody points.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredByHand {
    /// The dot.
    pub dot: Dot,
    /// Why there was nothing to fit, so that the centre is a hand's; `None` where the dot was fitted.
    pub refused: Option<String>,
    /// Place among the known dots of one that was measured again.
    pub known: Option<usize>,
}

impl MeasuredByHand {
    /// Measures at a place of the picture (px): the estimator of detection, and where it finds nothing the place itself
    /// with a hand's sigma. The known dots tell sizes. `None` outside the picture.
    #[must_use]
    pub fn at(picture: &GreyImage, place_px: Vector2<f64>, known: &[Dot]) -> Option<Self> {
        let by_hand = centre_by_hand_within(picture, place_px, known)?;
        let half_side = HALF_SIDE_PX.max(HALF_SIDE_DIAMETERS * by_hand.major_px);
        let (cut, corner) = cut_out(picture, place_px, half_side)?;
        let (dot, refused) =
            match measure_at(&cut, place_px - corner, &MeasureAtSettings::default()) {
                Ok(mut dot) => {
                    dot.centre_px += corner;
                    (dot, None)
                }
                Err(reason) => (by_hand, Some(reason)),
            };
        let near = |other: &Dot| (other.centre_px - dot.centre_px).norm() < SAME_DOT_PX;
        Some(Self {
            known: known.iter().position(near),
            dot,
            refused,
        })
    }

    /// How it was measured, for the operator.
    #[must_use]
    pub fn note(&self) -> String {
        let dot = &self.dot;
        match &self.refused {
            None => format!(
                "Measured: sigma {}, axes {:.1} x {:.1} px",
                format::sigma(dot.sigma_px, "px"),
                dot.major_px,
                dot.minor_px
            ),
            Some(reason) => format!(
                "Not measurable: {reason}. Set by hand, sigma {:.1} px",
                dot.sigma_px
            ),
        }
    }
}

fn centre_by_hand_within(picture: &GreyImage, place: Vector2<f64>, known: &[Dot]) -> Option<Dot> {
    let inside = place.x >= 0.0
        && place.y >= 0.0
        && place.x < picture.width() as f64
        && place.y < picture.height() as f64;
    inside.then(|| centre_by_hand(picture, place, known))
}

/// The part of a picture round a place, with its upper left corner, px.
fn cut_out(
    picture: &GreyImage,
    place: Vector2<f64>,
    half_side: f64,
) -> Option<(GreyImage, Vector2<f64>)> {
    let range = |at: f64, end: usize| {
        let from = (at - half_side).max(0.0) as usize;
        from..((at + half_side) as usize + 1).min(end)
    };
    let (columns, rows) = (
        range(place.x, picture.width()),
        range(place.y, picture.height()),
    );
    let samples = rows
        .clone()
        .flat_map(|row| picture.row(row)[columns.clone()].iter().copied())
        .collect();
    let size = (columns.len() as u32, rows.len() as u32);
    let cut = GreyImage::new(size.0, size.1, picture.depth(), samples).ok()?;
    Some((cut, Vector2::new(columns.start as f64, rows.start as f64)))
}
