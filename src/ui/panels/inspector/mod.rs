//! Everything on what is selected: a point, else a dot, else an image, else the whole measurement.

mod image;
mod known;
mod measurement;
mod missing;
mod naming;
mod point;

use std::collections::BTreeMap;

use egui::{Grid, ScrollArea, Ui};

use super::basis::Cached;
use super::facts::{Sight, select_image, sights};
use crate::network::{Absence, AbsenceKind, ImageId, PointId};
use crate::project::edit::Edit;
use crate::targets::DotIndex;
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;

/// The inspector.
#[derive(Default)]
pub struct Inspector {
    sights: Cached<PointId, Vec<Sight>>,
    images_without: Cached<PointId, Vec<(ImageId, Absence)>>,
    absent: Cached<ImageId, BTreeMap<AbsenceKind, Vec<(PointId, Absence)>>>,
    naming: naming::Naming,
    known: known::Known,
}

impl Inspector {
    /// Draws it.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        let network = context.network;
        let selection = context.selection;
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            if let Some(id) = selection.point {
                let sights = self.sights.get(network, id, |id| sights(network, *id));
                point::heading(ui, network, id, actions);
                self.naming.ui(ui, network, id, actions);
                point::ui(ui, context, id, sights, actions);
                let missing = |id: &PointId| missing::images_without(network, *id);
                let without = self.images_without.get(network, id, missing);
                missing::of_point(ui, context, id, without, actions);
                ui.separator();
                self.known.ui(ui, context, id, actions);
                if let Some((image, dot)) = selection.dot {
                    ui.separator();
                    image::dot(ui, context, image, dot, actions);
                }
            } else if let Some((image, dot)) = selection.dot {
                image::dot(ui, context, image, dot, actions);
            } else if let Some(id) = selection.image {
                image::ui(ui, context, id, actions);
                let absent = |id: &ImageId| missing::absent_by_kind(network, *id);
                let absent = self.absent.get(network, id, absent);
                missing::of_image(ui, context, id, absent, actions);
            } else {
                measurement::ui(ui, context);
            }
            if *selection != Selection::default() {
                ui.separator();
                if ui.button("Whole measurement").clicked() {
                    actions.push(Action::Select(Selection::default()));
                }
            }
        });
    }
}

/// A table of names and values.
fn facts(ui: &mut Ui, salt: &str, rows: &[(&str, String)]) {
    Grid::new(salt).num_columns(2).striped(true).show(ui, |ui| {
        for (name, value) in rows {
            ui.weak(*name);
            ui.label(value);
            ui.end_row();
        }
    });
}

/// Whether an edit about this dot waits for the end of the running step.
fn is_pending(context: &ViewContext<'_>, image: ImageId, dot: DotIndex) -> bool {
    context.pending.iter().any(|edit| match edit {
        Edit::Label {
            image: i, dot: d, ..
        }
        | Edit::Unlabel { image: i, dot: d }
        | Edit::Accept { image: i, dot: d }
        | Edit::Reject { image: i, dot: d }
        | Edit::Restore { image: i, dot: d } => (*i, *d) == (image, dot),
        _ => false,
    })
}

/// The button that rejects a labelled dot or restores a rejected one.
fn decision(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    image: ImageId,
    dot: DotIndex,
    rejected: Option<&str>,
    actions: &mut Vec<Action>,
) {
    if is_pending(context, image, dot) {
        ui.weak("waits for the step")
            .on_hover_text("Your edit is made when the running step ends.");
        return;
    }
    let (text, hover, edit) = match rejected {
        Some(reason) => ("Restore", reason, Edit::Restore { image, dot }),
        None => (
            "Reject",
            "The adjustment does not use it.",
            Edit::Reject { image, dot },
        ),
    };
    if ui.small_button(text).on_hover_text(hover).clicked() {
        actions.push(Action::Edit(edit));
    }
}

/// The name of an image, leading to it.
fn image_link(ui: &mut Ui, context: &ViewContext<'_>, id: ImageId, actions: &mut Vec<Action>) {
    let name = super::facts::image_name(context.network, id);
    if ui.link(name).clicked() {
        actions.push(Action::LookAt(select_image(id)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::facts::{select_observation, select_point};
    use crate::ui::panels::fixture::{Bench, network};
    use crate::ui::panels::stale::BEFORE_LAST_EDITS;
    use egui_kittest::kittest::Queryable as _;

    fn bench(selection: Selection) -> Bench {
        let mut panel = Inspector::default();
        Bench::selecting(network(), selection, move |ui, context, actions| {
            panel.ui(ui, context, actions);
        })
    }

    #[test]
    fn a_point_shows_its_sigmas_and_restores_its_observation() {
        let mut bench = bench(select_point("M1".parse().unwrap()));
        bench.harness.get_by_label("1.000 mm");
        bench.harness.get_by_label("0.010 mm");
        bench.harness.get_by_label("3.000 px");
        let (image, dot) = (ImageId(1), DotIndex(1));
        bench.harness.get_by_label("Restore").click();
        let expected = Action::Edit(Edit::Restore { image, dot });
        assert_eq!(bench.actions(), [expected]);
        bench.harness.get_by_label("Look").click();
        let seen = select_observation(image, dot, Some("M1".parse().unwrap()));
        assert_eq!(bench.actions(), [Action::LookAt(seen)]);
    }

    #[test]
    fn a_dot_says_why_it_has_no_name() {
        let bench = bench(select_observation(ImageId(1), DotIndex(4), None));
        bench.harness.get_by_label("two points are as near");
        bench.harness.get_by_label("14.000 px, 20.000 px");
    }

    #[test]
    fn an_image_shows_its_station_or_why_it_has_none() {
        let oriented = bench(select_image(ImageId(1)));
        oriented.harness.get_by_label("1500.00 mm");
        let lost = bench(select_image(ImageId(2)));
        lost.harness.get_by_label("too few codes");
    }

    #[test]
    fn with_nothing_selected_it_shows_camera_and_precision() {
        let mut bench = bench(Selection::default());
        bench.harness.get_by_label("20.12 mm");
        bench.harness.get_by_label("1.020");
        bench.change(|network| network.inputs += 1);
        bench.harness.get_by_label(BEFORE_LAST_EDITS);
    }

    #[test]
    fn targets_that_images_miss_are_told_with_their_reasons() {
        use crate::network::{Absence, Look};
        let mut network = network();
        let point: PointId = "C1".parse().unwrap();
        let image = network.image_mut(ImageId(1));
        std::sync::Arc::make_mut(&mut image.labels).retain(|_, label| label.point != point);
        let absence = Absence {
            place_px: nalgebra::Vector2::new(70.0, 80.0),
            kind: AbsenceKind::Covered,
            reason: "something stands before it".into(),
        };
        image.look = Some(std::sync::Arc::new(Look {
            absent: [(point, absence)].into(),
            ..Look::default()
        }));
        let mut panel = Inspector::default();
        let mut bench =
            Bench::selecting(network, select_point(point), move |ui, context, actions| {
                panel.ui(ui, context, actions);
            });
        bench
            .harness
            .get_by_label("images that ought to show it and do not: 1");
        bench.harness.get_by_label("covered");
        bench.harness.get_by_label("Look at its place").click();
        let actions = bench.actions();
        let [Action::LookAt(about)] = &actions[..] else {
            panic!("{actions:?}");
        };
        assert_eq!(about.place, Some((ImageId(1), [70.0, 80.0])));
        bench.select(select_image(ImageId(1)));
        bench
            .harness
            .get_by_label("targets that it ought to show and does not: 1");
        bench.harness.get_by_label("covered: 1");
    }

    #[test]
    fn a_plain_target_gets_another_name() {
        let mut bench = bench(select_point("M1".parse().unwrap()));
        let field = bench.harness.get_by_label("Name");
        field.focus();
        field.type_text("edge 7");
        bench.harness.run();
        bench.harness.get_by_label("Rename").click();
        let name = Some("edge 7".to_owned());
        let renamed = Action::Edit(Edit::RenameTarget { target: 1, name });
        assert_eq!(bench.actions(), [renamed]);
        bench.select(select_point("C1".parse().unwrap()));
        assert!(bench.harness.query_by_label("Rename").is_none());
    }

    #[test]
    fn the_field_of_the_name_follows_the_name() {
        let mut bench = bench(select_point("M1".parse().unwrap()));
        let names = BTreeMap::from([(1, "edge".to_owned())]);
        bench.change(|network| network.names = std::sync::Arc::new(names));
        let field = bench.harness.get_by_label("Name");
        assert_eq!(field.value().as_deref(), Some("edge"));
    }
}
