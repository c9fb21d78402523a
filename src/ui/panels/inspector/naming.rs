//! The name of a plain target: a field that gives it another one, or none.

use egui::{Key, TextEdit, Ui};

use crate::network::{Network, PointId};
use crate::project::edit::Edit;
use crate::ui::action::Action;

/// Width of the field, points.
const FIELD: f32 = 120.0;

/// A name while it is typed.
#[derive(Default)]
pub(super) struct Naming {
    draft: Option<Draft>,
}

/// What stands in the field.
struct Draft {
    target: u32,
    /// The name that the target had when the field was filled.
    filled_from: String,
    name: String,
}

impl Naming {
    /// Draws the field of a plain target; other points have names of their own.
    pub(super) fn ui(
        &mut self,
        ui: &mut Ui,
        network: &Network,
        id: PointId,
        actions: &mut Vec<Action>,
    ) {
        let PointId::Target(target) = id else {
            return;
        };
        let present = network.names.get(&target).map_or("", String::as_str);
        let fits = |draft: &Draft| draft.target == target && draft.filled_from == present;
        if !self.draft.as_ref().is_some_and(fits) {
            self.draft = Some(Draft {
                target,
                filled_from: present.to_owned(),
                name: present.to_owned(),
            });
        }
        let Some(Draft { name, .. }) = &mut self.draft else {
            return;
        };
        let asked = ui.horizontal(|ui| {
            let label = ui.label("Name");
            let field = TextEdit::singleline(name)
                .desired_width(FIELD)
                .hint_text(id.to_string());
            let field = ui.add(field).labelled_by(label.id);
            let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            let changed = name.trim() != present;
            let button = ui.add_enabled(changed, egui::Button::new("Rename"));
            let hover = format!("An empty field gives it back its label {id}.");
            button.on_hover_text(hover).clicked() || entered && changed
        });
        if asked.inner {
            let name = Some(name.trim().to_owned()).filter(|name| !name.is_empty());
            actions.push(Action::Edit(Edit::RenameTarget { target, name }));
            self.draft = None;
        }
    }
}
