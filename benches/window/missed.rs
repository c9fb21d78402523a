//! The paper's 23 leftovers: how many keys until they are measured.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use egui::{Key, Modifiers};
use tiepoint::network::{ImageEntry, ImageId, Label, Network, PointId};
use tiepoint::project::session::Session;
use tiepoint::targets::DotIndex;
use tiepoint::ui::app::App;

use super::desk::Desk;
use super::inputs::Inputs;
use super::{Row, ms};

/// Targets that are missing, as in the paper, each in another image.
const MISSED: usize = 23;

/// More presses than anybody would bear.
const MOST_PRESSES: usize = 300;

/// Frames between two presses; the operator looks longer.
const FRAMES: usize = 20;

/// What is missing of a target in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Missing {
    /// The dot is there, its name is not.
    Name,
    /// Detection has not found the dot.
    Dot,
}

pub(crate) fn keys_for_missed_targets(inputs: &Inputs) -> Vec<Row> {
    let mut rows = keys_for(
        inputs,
        Missing::Name,
        "naming 23 dots that identification left without names",
    );
    rows.extend(keys_for(
        inputs,
        Missing::Dot,
        "measuring 23 images of targets that detection missed",
    ));
    rows
}

fn keys_for(inputs: &Inputs, missing: Missing, what: &str) -> Vec<Row> {
    let project = inputs.before(None, &format!("missing-{missing:?}.tiepoint"));
    let mut session = Session::open(&project).expect("the measured project");
    let taken = session
        .edit("targets taken away", |network| take_away(network, missing))
        .expect("an edit");
    session.flush().expect("it is saved");
    drop(session);
    let mut desk = Desk::new();
    desk.open(&project);
    desk.harness.key_press_modifiers(Modifiers::ALT, Key::Num2);
    let mut presses = 1;
    let left = |app: &App| {
        let named = |(id, point): &&(ImageId, PointId)| {
            app.network().images[id]
                .labels
                .values()
                .any(|label| label.point == *point)
        };
        taken.len() - taken.iter().filter(named).count()
    };
    let mut longest = Duration::ZERO;
    let mut look = |desk: &mut Desk| {
        for _ in 0..FRAMES {
            longest = longest.max(desk.step());
        }
        desk.until(|app| !app.pictures().is_busy());
        for _ in 0..FRAMES {
            longest = longest.max(desk.step());
        }
    };
    look(&mut desk);
    let (mut open, mut last_gain) = (left(desk.app()), presses);
    while open > 0 && presses < MOST_PRESSES {
        desk.harness.key_press(Key::Space);
        presses += 1;
        look(&mut desk);
        let now = left(desk.app());
        if now < open {
            (open, last_gain) = (now, presses);
        }
    }
    let found = format!(
        "{last_gain} keys, no click, no dialog; {open} of {} left after {presses}",
        taken.len()
    );
    vec![
        Row::new(what, found, "23 to 46"),
        Row::new(
            "longest frame meanwhile, the window's part",
            ms(longest),
            "16 ms",
        ),
    ]
}

fn take_away(
    network: &mut Network,
    missing: Missing,
) -> Result<Vec<(ImageId, PointId)>, Infallible> {
    let images: Vec<ImageId> = network.used_images().map(|(id, _)| id).collect();
    let mut taken = Vec::new();
    for id in images {
        let labels = &network.images[&id].labels;
        let plain =
            |label: &Label| matches!(label.point, PointId::Target(_)) && label.rejected.is_none();
        // Each another target: one that is taken out of many images is no longer known from many sides.
        let is_new = |label: &Label| taken.iter().all(|(_, point)| *point != label.point);
        let found = labels
            .iter()
            .find(|(_, label)| plain(label) && is_new(label))
            .map(|(dot, label)| (*dot, label.point));
        if let Some((dot, point)) = found.filter(|_| taken.len() < MISSED) {
            match missing {
                Missing::Name => {
                    drop(Arc::make_mut(&mut network.image_mut(id).labels).remove(&dot));
                }
                Missing::Dot => remove_dot(network, id, dot),
            }
            taken.push((id, point));
        }
    }
    Ok(taken)
}

/// Makes a picture as if detection had not found a dot.
fn remove_dot(network: &mut Network, id: ImageId, gone: DotIndex) {
    let after = |dot: DotIndex| if dot > gone { DotIndex(dot.0 - 1) } else { dot };
    let image: &mut ImageEntry = network.image_mut(id);
    let labels = image.labels.iter().filter(|(dot, _)| **dot != gone);
    image.labels = Arc::new(
        labels
            .map(|(dot, label)| (after(*dot), label.clone()))
            .collect(),
    );
    let unlabelled = image.unlabelled.iter().filter(|(dot, _)| **dot != gone);
    image.unlabelled = Arc::new(
        unlabelled
            .map(|(dot, why)| (after(*dot), why.clone()))
            .collect(),
    );
    if let Some(detections) = image.detections.as_mut().map(Arc::make_mut) {
        detections.dots.remove(gone.slot());
        for dot in detections.codes.iter_mut().flat_map(|code| &mut code.dots) {
            *dot = after(*dot);
        }
    }
    if let Some(adjustment) = network.adjustment.as_mut().map(Arc::make_mut) {
        adjustment
            .observations
            .retain(|observation| (observation.image, observation.dot) != (id, gone));
        for observation in adjustment
            .observations
            .iter_mut()
            .filter(|observation| observation.image == id)
        {
            observation.dot = after(observation.dot);
        }
    }
}
