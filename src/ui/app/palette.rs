//! The command palette and the list of keys.

use egui::{
    Align2, Context, Event, Grid, Key, KeyboardShortcut, Modifiers, ScrollArea, TextEdit, Ui,
    Window, vec2,
};

use super::catalogue::VIEW_KEYS;
use super::{App, Command};
use crate::network::{Network, PointId};
use crate::ui::action::{Action, Selection};
use crate::ui::image_view::ImageView;

/// Entries that the palette shows at once.
const SHOWN: usize = 14;

/// Which of the two lists is open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Open {
    #[default]
    Nothing,
    Commands,
    Keys,
}

/// The palette's state.
#[derive(Default)]
pub(super) struct Palette {
    open: Open,
    text: String,
    chosen: usize,
}

/// Keys that move and choose in the palette.
struct Pressed {
    up: bool,
    down: bool,
    enter: bool,
}

/// One line of the palette.
struct Entry {
    text: String,
    action: Action,
}

impl Palette {
    pub(super) fn open_commands(&mut self) {
        *self = Self {
            open: Open::Commands,
            ..Self::default()
        };
    }

    pub(super) fn open_keys(&mut self) {
        self.open = Open::Keys;
    }

    pub(super) fn is_open(&self) -> bool {
        self.open != Open::Nothing
    }

    pub(super) fn close(&mut self) {
        self.open = Open::Nothing;
    }
}

impl App {
    /// The palette, the list of keys, and the forms.
    pub(super) fn windows(&mut self, context: &Context, actions: &mut Vec<Action>) {
        match self.palette.open {
            Open::Nothing => {}
            Open::Commands => self.palette_window(context, actions),
            Open::Keys => self.keys_window(context),
        }
        self.forms_window(context, actions);
    }

    /// Whether the palette, the list of keys or a form lies over the panels.
    fn has_dialog(&self) -> bool {
        self.palette.is_open() || self.forms.is_open()
    }

    /// Takes the keys that panels behind a dialog must not hear; none where a text field has them anyway.
    pub(super) fn take_keys_of_dialog(&self, context: &Context) -> Vec<Event> {
        if !self.has_dialog() || context.text_edit_focused() {
            return Vec::new();
        }
        context.input_mut(|input| {
            let all = std::mem::take(&mut input.events);
            let (keys, others) = all
                .into_iter()
                .partition(|event| matches!(event, Event::Key { .. }));
            input.events = others;
            keys
        })
    }

    /// Esc closes what lies on top before anything else hears of it.
    pub(super) fn modal_keys(&mut self, context: &Context) {
        if self.has_dialog()
            && context.input_mut(|input| input.consume_key(Modifiers::NONE, Key::Escape))
        {
            self.palette.close();
            self.forms.close();
        }
    }

    fn palette_window(&mut self, context: &Context, actions: &mut Vec<Action>) {
        let mut palette = std::mem::take(&mut self.palette);
        let mut done = false;
        Window::new("Commands, images, points")
            .anchor(Align2::CENTER_TOP, vec2(0.0, 60.0))
            .resizable(false)
            .collapsible(false)
            .show(context, |ui| {
                let pressed = palette.type_in(ui);
                // After the field, so that Enter takes what the last letter finds, were both typed between two frames.
                let entries = self.entries(&palette.text);
                done = palette.choose(ui, pressed, &entries, actions);
            });
        if done {
            palette.close();
            // Else the field keeps the keyboard until a frame has missed it.
            context.memory_mut(egui::Memory::stop_text_input);
        }
        self.palette = palette;
    }

    /// What the text in the palette finds: commands first, then images and points.
    fn entries(&self, text: &str) -> Vec<Entry> {
        let words: Vec<String> = text.split_whitespace().map(str::to_lowercase).collect();
        let fits = |text: &str| {
            let text = text.to_lowercase();
            words.iter().all(|word| text.contains(word.as_str()))
        };
        let network = self.network();
        let commands = Command::ALL
            .into_iter()
            .filter(|command| self.can(*command))
            .map(|command| Entry {
                text: command.title().to_owned(),
                action: Action::Do(command),
            });
        let images = network.images.iter().map(|(id, image)| Entry {
            text: format!("image {}", image.file.path),
            action: Action::Select(Selection {
                image: Some(*id),
                ..Selection::default()
            }),
        });
        let points = network.points.keys().map(|id| Entry {
            text: format!("point {}", network.label(*id)),
            action: Action::LookAt(Selection {
                point: Some(*id),
                ..Selection::default()
            }),
        });
        let mut found: Vec<Entry> = commands
            .chain(images)
            .chain(points)
            .filter(|entry| fits(&entry.text))
            .take(SHOWN)
            .collect();
        if let Some(point) = exact_point(network, text) {
            let text = format!("point {}", network.label(point));
            found.retain(|entry| entry.text != text);
            let selection = Selection {
                point: Some(point),
                ..Selection::default()
            };
            found.insert(
                0,
                Entry {
                    text,
                    action: Action::LookAt(selection),
                },
            );
        }
        found
    }

    fn keys_window(&mut self, context: &Context) {
        let mut open = true;
        Window::new("All keys")
            .open(&mut open)
            .collapsible(false)
            .anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0))
            .default_size(vec2(760.0, 640.0))
            .show(context, |ui| {
                ScrollArea::vertical().show(ui, |ui| {
                    ui.horizontal_top(|ui| {
                        ui.vertical(keys_of_commands);
                        ui.add_space(24.0);
                        ui.vertical(keys_of_views);
                    });
                });
            });
        if !open {
            self.palette.close();
        }
    }

    /// Commands by their keys with Alt, taken before the panels draw: a view would take the letter with Alt held as well.
    pub(super) fn keys_with_alt(&self, context: &Context) -> Vec<Action> {
        self.commands_by_key(context, |shortcut| shortcut.modifiers.alt)
    }

    /// Commands by their other keys, and what was dropped on the window.
    pub(super) fn shortcuts(&self, context: &Context) -> Vec<Action> {
        // A dialog has the keyboard from its first frame on, before the focus of a field in it is known.
        let typing = context.text_edit_focused() || self.has_dialog();
        let mut actions = self.commands_by_key(context, |shortcut| {
            !(shortcut.modifiers.alt || typing && belongs_to_text(shortcut))
        });
        let dropped: Vec<_> = context
            .input_mut(|input| std::mem::take(&mut input.raw.dropped_files))
            .iter()
            .map(|file| file.path().to_owned())
            .collect();
        if !dropped.is_empty() {
            actions.push(Action::Dropped(dropped));
        }
        actions
    }

    fn commands_by_key(
        &self,
        context: &Context,
        wanted: impl Fn(&KeyboardShortcut) -> bool,
    ) -> Vec<Action> {
        let escape_is_theirs = self
            .panels
            .views
            .iter()
            .flatten()
            .any(ImageView::wants_escape);
        let mut commands: Vec<(Command, KeyboardShortcut)> = Command::ALL
            .into_iter()
            .filter(|command| !(*command == Command::Interrupt && escape_is_theirs))
            .filter_map(|command| Some((command, command.shortcut().filter(&wanted)?)))
            .collect();
        // Those with more modifier keys first: Shift+F5 is also F5.
        commands.sort_by_key(|(_, shortcut)| {
            let keys = shortcut.modifiers;
            let held = [keys.alt, keys.ctrl || keys.command, keys.shift];
            std::cmp::Reverse(held.into_iter().filter(|held| *held).count())
        });
        context.input_mut(|input| {
            commands.retain(|(_, shortcut)| input.consume_shortcut(shortcut));
        });
        commands
            .into_iter()
            .filter(|(command, _)| self.can(*command))
            .map(|(command, _)| Action::Do(command))
            .collect()
    }
}

/// Whether a text field with the focus takes this key: what is typed, and taking back what was typed.
fn belongs_to_text(shortcut: &KeyboardShortcut) -> bool {
    let key = shortcut.logical_key;
    match shortcut.modifiers.any() {
        true => matches!(key, Key::Z | Key::Y),
        false => !matches!(key, Key::F5 | Key::Escape),
    }
}

impl Palette {
    /// Draws the field and takes what is typed; the keys that move and choose.
    fn type_in(&mut self, ui: &mut Ui) -> Pressed {
        let pressed = ui.input_mut(|input| Pressed {
            up: input.consume_key(Modifiers::NONE, Key::ArrowUp),
            down: input.consume_key(Modifiers::NONE, Key::ArrowDown),
            enter: input.consume_key(Modifiers::NONE, Key::Enter),
        });
        let field = ui.add(
            TextEdit::singleline(&mut self.text)
                .hint_text("type to find")
                .desired_width(360.0),
        );
        field.request_focus();
        if field.changed() {
            self.chosen = 0;
        }
        pressed
    }

    /// Draws what the text finds; true when something was chosen.
    fn choose(
        &mut self,
        ui: &mut Ui,
        pressed: Pressed,
        entries: &[Entry],
        actions: &mut Vec<Action>,
    ) -> bool {
        let last = entries.len().saturating_sub(1);
        self.chosen = match (pressed.up, pressed.down) {
            (true, _) => self.chosen.saturating_sub(1),
            (_, true) => (self.chosen + 1).min(last),
            _ => self.chosen.min(last),
        };
        let mut taken = pressed.enter.then_some(self.chosen);
        for (place, entry) in entries.iter().enumerate() {
            if ui
                .selectable_label(place == self.chosen, &entry.text)
                .clicked()
            {
                taken = Some(place);
            }
        }
        if entries.is_empty() {
            ui.weak("Nothing is called so.");
        }
        match taken.and_then(|place| entries.get(place)) {
            Some(entry) => {
                actions.push(entry.action.clone());
                true
            }
            None => false,
        }
    }
}

fn keys_of_commands(ui: &mut Ui) {
    ui.strong("Everywhere");
    Grid::new("keys of commands").striped(true).show(ui, |ui| {
        for command in Command::ALL {
            if let Some(keys) = command.shortcut() {
                ui.monospace(ui.ctx().format_shortcut(&keys));
                ui.label(command.title());
                ui.end_row();
            }
        }
    });
}

fn keys_of_views(ui: &mut Ui) {
    for keys in VIEW_KEYS.chunk_by(|one, next| one.place == next.place) {
        let place = keys[0].place;
        ui.strong(place);
        Grid::new(place).striped(true).show(ui, |ui| {
            for key in keys {
                ui.monospace(key.keys);
                ui.label(key.meaning);
                ui.end_row();
            }
        });
        ui.add_space(8.0);
    }
}

/// The point with exactly this label.
fn exact_point(network: &Network, text: &str) -> Option<PointId> {
    let point = network.point_of_label(text).ok()?;
    network.points.contains_key(&point).then_some(point)
}
