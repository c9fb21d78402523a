//! What stands where a target was missed: measured once for the present item, as soon as its picture is there.

use std::sync::Arc;

use super::items::{ReviewItem, ReviewKind};
use crate::network::{ImageEntry, ImageId, Network, PointId};
use crate::project::edit::Edit;
use crate::targets::DotIndex;
use crate::ui::context::ViewContext;
use crate::ui::image_view::{MeasuredByHand, NOTHING_THERE, misfit_of};
use crate::ui::pictures::PictureState;

/// What helps where nothing can be measured.
pub(super) const CLICK_SETS_IT: &str = "A and a click sets it by hand";

/// The measurement of the present item.
#[derive(Default)]
pub(super) struct Measured {
    of: Option<Of>,
    state: State,
}

/// What was measured: a target in an image as it was then.
struct Of {
    point: PointId,
    image: Arc<ImageEntry>,
    place: [f64; 2],
}

#[derive(Default)]
enum State {
    #[default]
    NoPicture,
    Missing(String),
    Outside,
    Found {
        measured: MeasuredByHand,
        /// What it is, or how far it is from where it should be.
        place: String,
    },
}

impl Measured {
    /// Measures the item's target unless that is done, or there is nothing to measure.
    pub(super) fn look(&mut self, context: &ViewContext<'_>, item: &ReviewItem) {
        let Some((id, point, place)) = missed(item) else {
            self.of = None;
            return;
        };
        let Some(image) = context.network.images.get(&id) else {
            return;
        };
        let same =
            |of: &Of| of.point == point && of.place == place && Arc::ptr_eq(&of.image, image);
        if self.of.as_ref().is_some_and(same) && !matches!(self.state, State::NoPicture) {
            return;
        }
        self.of = Some(Of {
            point,
            image: Arc::clone(image),
            place,
        });
        self.state = match context.pictures.get(id, image) {
            PictureState::Loading => State::NoPicture,
            PictureState::Missing(reason) => State::Missing(reason),
            PictureState::Ready(picture) => {
                let dots = image.detections.as_ref().map_or(&[][..], |d| &d.dots);
                match MeasuredByHand::at(&picture, place.into(), dots) {
                    None => State::Outside,
                    Some(measured) => State::Found {
                        place: where_it_is(context.network, image, point, &measured),
                        measured,
                    },
                }
            }
        };
    }

    /// What was measured, for the operator.
    pub(super) fn note(&self) -> String {
        match &self.state {
            State::NoPicture => "Its picture is being read.".into(),
            State::Missing(reason) => format!("Its picture cannot be read: {reason}"),
            State::Outside => "Its place is outside the picture.".into(),
            State::Found { measured, place } => match &measured.refused {
                None => format!("{}{place}", measured.note()),
                // The predicted place is no measurement: put in as one, it would confirm itself.
                Some(reason) => format!("{NOTHING_THERE}: {reason}. {CLICK_SETS_IT}."),
            },
        }
    }

    /// Whether the picture shows nothing that could be measured at the predicted place: then only a click of the
    /// operator makes a centre.
    pub(super) fn is_nothing(&self) -> bool {
        match &self.state {
            State::Found { measured, .. } => self.of.is_some() && measured.refused.is_some(),
            _ => false,
        }
    }

    /// The edit that accepts the item; `None` where there is nothing to accept.
    pub(super) fn edit(&self, network: &Network, item: &ReviewItem) -> Option<Edit> {
        let (image, point, place) = missed(item)?;
        let of = self.of.as_ref()?;
        let same = of.point == point && of.place == place;
        let State::Found { measured, .. } = &self.state else {
            return None;
        };
        match measured.known.filter(|_| same) {
            None if measured.refused.is_some() => None,
            None => same.then(|| Edit::AddDot {
                image,
                dot: measured.dot.clone(),
                point: Some(point),
            }),
            Some(slot) => {
                let dot = DotIndex(slot as u32);
                let free = !network.images.get(&image)?.labels.contains_key(&dot);
                free.then_some(Edit::Label { image, dot, point })
            }
        }
    }
}

fn missed(item: &ReviewItem) -> Option<(ImageId, PointId, [f64; 2])> {
    let (image, place) = item.about.place?;
    (item.kind == ReviewKind::MissedTarget).then_some((image, item.about.point?, place))
}

fn where_it_is(
    network: &Network,
    image: &ImageEntry,
    point: PointId,
    measured: &MeasuredByHand,
) -> String {
    let label = |slot: usize| image.labels.get(&DotIndex(slot as u32));
    if let Some(other) = measured.known.and_then(label) {
        let name = network.label(other.point);
        return format!("; but that dot is {name}: it cannot be accepted");
    }
    let misfit = misfit_of(network, image, point, measured.dot.centre_px);
    misfit.map_or(String::new(), |m| {
        format!(
            "; {:.2} px ({:.1} sigma) from its predicted place",
            m.distance_px, m.sigmas
        )
    })
}
