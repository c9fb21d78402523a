//! Targets that images ought to show and do not, with the reasons of the last look: of one target, and of one image.

use std::collections::BTreeMap;

use egui::{CollapsingHeader, Grid, Ui};

use super::image_link;
use crate::network::{Absence, AbsenceKind, ImageId, Network, PointId};
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;
use crate::ui::format::pixels;

/// Names that are listed of one class; the export lists all.
const MOST_NAMES: usize = 60;

/// The images that ought to show a target and do not.
pub(super) fn images_without(network: &Network, point: PointId) -> Vec<(ImageId, Absence)> {
    let images = network.oriented_images();
    let of_image = |(id, image, _): (ImageId, &crate::network::ImageEntry, _)| {
        let mut absent = image.absent();
        let (_, absence) = absent.find(|(other, _)| *other == point)?;
        Some((id, absence.clone()))
    };
    images.filter_map(of_image).collect()
}

/// The targets that an image ought to show and does not, by class.
pub(super) fn absent_by_kind(
    network: &Network,
    image: ImageId,
) -> BTreeMap<AbsenceKind, Vec<(PointId, Absence)>> {
    let mut kinds: BTreeMap<AbsenceKind, Vec<(PointId, Absence)>> = BTreeMap::new();
    let absent = network.images.get(&image).into_iter();
    for (point, absence) in absent.flat_map(|image| image.absent()) {
        let of_kind = kinds.entry(absence.kind).or_default();
        of_kind.push((point, absence.clone()));
    }
    kinds
}

/// The images without a target, each with its reason.
pub(super) fn of_point(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    point: PointId,
    images: &[(ImageId, Absence)],
    actions: &mut Vec<Action>,
) {
    if images.is_empty() {
        return;
    }
    ui.separator();
    let title = format!("images that ought to show it and do not: {}", images.len());
    let header = CollapsingHeader::new(title).id_salt("images without it");
    header.default_open(true).show(ui, |ui| {
        Grid::new("images without it")
            .num_columns(3)
            .striped(true)
            .show(ui, |ui| {
                for (image, absence) in images {
                    row(ui, context, *image, (point, absence), actions);
                    ui.end_row();
                }
            });
    });
}

fn row(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    image: ImageId,
    (point, absence): (PointId, &Absence),
    actions: &mut Vec<Action>,
) {
    image_link(ui, context, image, actions);
    let place = absence.place_px;
    let look = ui.small_button("Look at its place");
    let hover = format!("x {}, y {}", pixels(place.x), pixels(place.y));
    if look.on_hover_text(hover).clicked() {
        actions.push(Action::LookAt(select_place(image, point, absence)));
    }
    ui.label(absence.kind.to_string())
        .on_hover_text(&absence.reason);
}

/// The missing targets of an image: how many of each class, and which.
pub(super) fn of_image(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    image: ImageId,
    kinds: &BTreeMap<AbsenceKind, Vec<(PointId, Absence)>>,
    actions: &mut Vec<Action>,
) {
    let look = context.network.images.get(&image);
    let Some(look) = look.and_then(|image| image.look.as_ref()) else {
        return;
    };
    ui.separator();
    if let Some(reason) = &look.unreadable {
        ui.label(format!("Nobody could look for missing targets: {reason}"));
        return;
    }
    let count: usize = kinds.values().map(Vec::len).sum();
    ui.label(format!(
        "targets that it ought to show and does not: {count}"
    ));
    for (kind, absent) in kinds {
        let title = format!("{kind}: {}", absent.len());
        let header = CollapsingHeader::new(title).id_salt(("missing", kind.to_string()));
        header.show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                for (point, absence) in absent.iter().take(MOST_NAMES) {
                    let link = ui.link(context.network.label(*point));
                    if link.on_hover_text(&absence.reason).clicked() {
                        actions.push(Action::LookAt(select_place(image, *point, absence)));
                    }
                }
                if let Some(more) = absent
                    .len()
                    .checked_sub(MOST_NAMES)
                    .filter(|more| *more > 0)
                {
                    ui.weak(format!("and {more} more"));
                }
            });
        });
    }
}

fn select_place(image: ImageId, point: PointId, absence: &Absence) -> Selection {
    Selection {
        point: Some(point),
        image: Some(image),
        place: Some((image, absence.place_px.into())),
        ..Selection::default()
    }
}
