//! Forms that ask for paths and for what a project is made of: no frame waits for them, and every one has a field to
//! type into, because the dialogs of a system may be missing.

use std::path::{Path, PathBuf};

use egui::{Align2, Context, Grid, Key, Response, TextEdit, Ui, Window, vec2};

use super::App;
use crate::network::IdentificationRule;
use crate::project::making::ProjectPlan;
use crate::project::proposal::{NewProject, Proposal};
use crate::targets::Family;
use crate::ui::action::Action;
use crate::ui::theme;
use crate::worker::apart;

/// Width of the fields for paths, points.
const FIELD: f32 = 420.0;

/// A question that one path answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ask {
    /// Which project to open.
    Project,
    /// Where the images of a new project are.
    Images,
    /// Where to write a copy.
    Copy,
    /// Where missing pictures may be.
    Pictures,
    /// Which list names the targets.
    List,
}

impl Ask {
    fn title(self) -> &'static str {
        match self {
            Ask::Project => "Open a project",
            Ask::Images => "New project: folder of images",
            Ask::Copy => "Save a copy",
            Ask::Pictures => "Find pictures",
            Ask::List => "Name targets by a list: label,x_mm,y_mm,z_mm",
        }
    }

    fn button(self) -> &'static str {
        match self {
            Ask::Project => "Open",
            Ask::Images => "Next",
            Ask::Copy => "Save",
            Ask::Pictures => "Look there",
            Ask::List => "Name",
        }
    }

    fn action(self, path: PathBuf) -> Action {
        match self {
            Ask::Project => Action::Open(path),
            Ask::Images => Action::Dropped(vec![path]),
            Ask::Copy => Action::SaveCopy(path),
            Ask::Pictures => Action::FindPictures(path),
            Ask::List => Action::NameByList(path),
        }
    }
}

/// The open form.
#[derive(Default)]
enum Form {
    #[default]
    None,
    Path {
        ask: Ask,
        path: String,
    },
    New(Box<NewForm>),
    /// Something to read.
    Told {
        title: &'static str,
        text: String,
    },
}

/// What a new project is made of, as typed.
struct NewForm {
    project: String,
    images: Vec<PathBuf>,
    cameras: Vec<PathBuf>,
    /// Names and paths of the other files, empty where there is none.
    files: [(&'static str, String); 4],
    families: Vec<Family>,
    identification: IdentificationRule,
    projects_there: Vec<PathBuf>,
    not_used: Vec<PathBuf>,
    /// Whether the first field still has to take the keyboard.
    fresh: bool,
}

impl NewForm {
    fn of(proposal: NewProject) -> Self {
        let NewProject {
            plan,
            projects_there,
            not_used,
        } = proposal;
        let text = |path: Option<PathBuf>| {
            path.map_or_else(String::new, |path| path.display().to_string())
        };
        Self {
            project: plan.project.display().to_string(),
            images: plan.images,
            cameras: plan.cameras,
            files: [
                ("Sizes of targets", text(plan.targets)),
                ("Reference cross", text(plan.cross)),
                ("Scale bars", text(plan.bars)),
                ("Control points", text(plan.control)),
            ],
            families: plan.families,
            identification: plan.identification,
            projects_there,
            not_used,
            fresh: true,
        }
    }

    fn plan(&self) -> ProjectPlan {
        let path = |text: &str| {
            Some(text.trim())
                .filter(|text| !text.is_empty())
                .map(PathBuf::from)
        };
        let [targets, cross, bars, control] = self.files.each_ref().map(|(_, text)| path(text));
        ProjectPlan {
            project: PathBuf::from(self.project.trim()),
            images: self.images.clone(),
            cameras: self.cameras.clone(),
            targets,
            cross,
            bars,
            control,
            families: self.families.clone(),
            identification: self.identification,
        }
    }

    /// Draws it; the plan when it is to be made.
    fn ui(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) -> Option<ProjectPlan> {
        for path in &self.projects_there {
            ui.horizontal(|ui| {
                ui.colored_label(theme::DOUBTFUL, "There is a project already:");
                if ui.link(path.display().to_string()).clicked() {
                    actions.push(Action::Open(path.clone()));
                }
            });
        }
        Grid::new("new project").num_columns(2).show(ui, |ui| {
            let first = field(ui, "Project file", &mut self.project);
            if self.fresh && first.has_focus() {
                self.fresh = false;
            } else if self.fresh {
                // Again, where the grid was only measured.
                first.request_focus();
            }
            ui.label("Images");
            ui.label(self.images.len().to_string());
            ui.end_row();
            ui.label("Cameras");
            let cameras: Vec<String> = self
                .cameras
                .iter()
                .map(|path| path.display().to_string())
                .collect();
            ui.label(if cameras.is_empty() {
                "from EXIF data, else estimated".into()
            } else {
                cameras.join(", ")
            });
            ui.end_row();
            for (name, text) in &mut self.files {
                field(ui, name, text);
            }
        });
        ui.horizontal_wrapped(|ui| {
            ui.label("Codes");
            for family in Family::ALL {
                let mut sought = self.families.contains(&family);
                let checkbox = ui.checkbox(&mut sought, family.to_string());
                if checkbox.on_hover_text(look_of(family)).changed() {
                    self.families.retain(|other| *other != family);
                    if sought {
                        self.families.push(family);
                    }
                }
            }
        });
        if !self.not_used.is_empty() {
            let names: Vec<String> = self
                .not_used
                .iter()
                .map(|path| path.display().to_string())
                .collect();
            ui.weak(format!("Not used: {}", names.join(", ")));
        }
        let ready = !self.project.trim().is_empty() && !self.images.is_empty();
        let made = ui
            .add_enabled(ready, egui::Button::new("Make the project"))
            .clicked();
        made.then(|| self.plan())
    }
}

/// How to know the codes of a family.
fn look_of(family: Family) -> String {
    match family {
        Family::Dot420 => {
            "Six bright dots: three of an L-shaped axis and three that tell the number".into()
        }
        Family::Ring(segments) => format!(
            "A bright dot in a ring of {segments} segments, bright or dark; usual name: {segments} bit"
        ),
    }
}

fn field(ui: &mut Ui, name: &str, text: &mut String) -> Response {
    let label = ui.label(name);
    let field = ui
        .add(
            TextEdit::singleline(text)
                .desired_width(FIELD)
                .hint_text("none")
                // A cell of a grid is narrower at first, and a path is read to its end.
                .min_size(vec2(FIELD, 0.0)),
        )
        .labelled_by(label.id);
    ui.end_row();
    field
}

/// The forms' state.
#[derive(Default)]
pub(super) struct Forms {
    form: Form,
    /// Whether the field was just opened: then it takes the keyboard.
    fresh: bool,
    /// How many forms have asked for a path: the number of the last one.
    asked: u64,
}

impl Forms {
    pub(super) fn is_open(&self) -> bool {
        !matches!(self.form, Form::None)
    }

    pub(super) fn close(&mut self) {
        self.form = Form::None;
    }

    pub(super) fn ask_new(&mut self) {
        self.ask(Ask::Images, String::new());
    }

    pub(super) fn ask_open(&mut self) {
        self.ask(Ask::Project, String::new());
    }

    pub(super) fn ask_copy(&mut self, project: &Path) {
        let name = project.file_stem().unwrap_or_default().to_string_lossy();
        let copy = project.with_file_name(format!("{name}-copy.tiepoint"));
        self.ask(Ask::Copy, copy.display().to_string());
    }

    pub(super) fn ask_pictures(&mut self) {
        self.ask(Ask::Pictures, String::new());
    }

    pub(super) fn ask_list(&mut self) {
        self.ask(Ask::List, String::new());
    }

    /// Shows a text until the operator has read it.
    pub(super) fn tell(&mut self, title: &'static str, text: String) {
        self.form = Form::Told { title, text };
    }

    fn ask(&mut self, ask: Ask, path: String) {
        *self = Self {
            form: Form::Path { ask, path },
            fresh: true,
            asked: self.asked + 1,
        };
    }

    /// A dialog of the system answered; the form that asked may be gone.
    pub(super) fn chosen(&mut self, form: u64, chosen: &Path) {
        if let Form::Path { path, .. } = &mut self.form
            && form == self.asked
        {
            *path = chosen.display().to_string();
        }
    }

    /// What became of files that were dropped or named: the operator looks at it before anything is made.
    pub(super) fn take(&mut self, proposal: Proposal) -> Option<Action> {
        match proposal {
            Proposal::Open(path) => return Some(Action::Open(path)),
            Proposal::New(project) => self.form = Form::New(Box::new(NewForm::of(*project))),
            Proposal::Nothing(line) => return Some(Action::Refuse(line)),
        }
        None
    }
}

impl App {
    pub(super) fn forms_window(&mut self, context: &Context, actions: &mut Vec<Action>) {
        let window = |title: &str| {
            Window::new(title.to_owned())
                .anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0))
                .collapsible(false)
        };
        let mut done = Done::No;
        match &mut self.forms.form {
            Form::None => return,
            Form::New(form) => {
                window("New project").show(context, |ui| {
                    if let Some(plan) = form.ui(ui, actions) {
                        done = Done::With(Action::Make(Box::new(plan)));
                    }
                    if ui.button("Cancel").clicked() {
                        done = Done::Without;
                    }
                });
            }
            Form::Told { title, text } => {
                window(title).show(context, |ui| {
                    if read(ui, text) {
                        done = Done::Without;
                    }
                });
            }
            Form::Path { ask, path } => {
                let (ask, fresh) = (*ask, std::mem::take(&mut self.forms.fresh));
                let mut browse = false;
                window(ask.title()).show(context, |ui| {
                    done = path_field(ui, ask, path, fresh, &mut browse);
                });
                if browse {
                    self.browse(ask, context);
                }
            }
        }
        if !matches!(done, Done::No) {
            // Else the field keeps the keyboard until a frame has missed it.
            context.memory_mut(egui::Memory::stop_text_input);
        }
        match done {
            Done::No => {}
            Done::Without => self.forms.close(),
            Done::With(action) => {
                self.forms.close();
                actions.push(action);
            }
        }
    }

    /// Asks by a dialog of the system, on a thread of its own: dialogs may wait, frames may not.
    fn browse(&mut self, asked: Ask, context: &Context) {
        let (ask, context) = (self.ask.clone(), context.clone());
        let form = self.forms.asked;
        let started = apart("dialog", move || {
            let dialog = rfd::FileDialog::new();
            let chosen = match asked {
                Ask::Project => dialog
                    .add_filter("Tiepoint project", &["tiepoint"])
                    .pick_file(),
                Ask::List => dialog.add_filter("List of points", &["csv"]).pick_file(),
                Ask::Copy => dialog.set_file_name("copy.tiepoint").save_file(),
                Ask::Images | Ask::Pictures => dialog.pick_folder(),
            };
            if let Some(path) = chosen
                && ask.send(Action::Chosen { form, path }).is_ok()
            {
                context.request_repaint();
            }
        });
        if let Err(error) = started {
            self.say(format!(
                "The dialog could not be opened: {error}; type the path instead."
            ));
        }
    }
}

/// Whether a form is done with.
enum Done {
    No,
    Without,
    With(Action),
}

/// A text to scroll through; whether it was read.
fn read(ui: &mut Ui, text: &str) -> bool {
    const SIZE: [f32; 2] = [760.0, 400.0];
    ui.set_min_width(SIZE[0]);
    egui::ScrollArea::both().max_height(SIZE[1]).show(ui, |ui| {
        ui.add(egui::Label::new(egui::RichText::new(text).monospace()).extend());
    });
    ui.button("Close").clicked()
}

fn path_field(ui: &mut Ui, ask: Ask, path: &mut String, fresh: bool, browse: &mut bool) -> Done {
    let label = ui.label("Path");
    let field = ui
        .add(TextEdit::singleline(path).desired_width(FIELD))
        .labelled_by(label.id);
    if fresh {
        field.request_focus();
    }
    let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
    ui.horizontal(|ui| {
        *browse = ui.button("Browse ...").clicked();
        let clicked = ui.button(ask.button()).clicked();
        if ui.button("Cancel").clicked() {
            return Done::Without;
        }
        let path = path.trim();
        if (clicked || entered) && !path.is_empty() {
            Done::With(ask.action(PathBuf::from(path)))
        } else {
            Done::No
        }
    })
    .inner
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_answer_of_a_dialog_fills_only_the_form_that_asked() {
        let mut forms = Forms::default();
        let typed = |forms: &Forms| match &forms.form {
            Form::Path { path, .. } => path.clone(),
            _ => String::new(),
        };
        forms.ask_open();
        let first = forms.asked;
        forms.close();
        forms.ask_list();
        forms.chosen(first, Path::new("a.tiepoint"));
        assert_eq!(typed(&forms), "");
        forms.chosen(forms.asked, Path::new("points.csv"));
        assert_eq!(typed(&forms), "points.csv");
    }
}
