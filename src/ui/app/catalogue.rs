//! Every command of the window with its name, key and meaning: menu, keys, palette and the list of keys come from here.

use egui::{Key, KeyboardShortcut, Modifiers};

use crate::ui::layout::Pane;

/// What the operator can ask for from anywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// One step of the next stage that has one.
    Step,
    /// The next stage to its end.
    RunStage,
    /// All stages.
    RunAll,
    /// Stop the step under way.
    Interrupt,
    /// Take the last step or edit back.
    Undo,
    /// Do again what was taken back.
    Redo,
    /// A new project from a folder of images.
    New,
    /// Open a project file.
    Open,
    /// Render and measure the demo.
    Demo,
    /// Write the project to another file.
    SaveCopy,
    /// Look for missing pictures in a folder.
    FindPictures,
    /// Name the plain targets by a list of approximate coordinates.
    NameByList,
    /// Close the project.
    Close,
    /// Leave.
    Quit,
    /// The next image in the first image panel.
    NextImage,
    /// The image before.
    PreviousImage,
    /// Bring what is selected into view everywhere.
    GoToSelection,
    /// So many image panels.
    ImagePanels(usize),
    /// Bring a panel to the front.
    Show(Pane),
    /// The first layout again.
    FirstLayout,
    /// All of the network in sight.
    FitNetwork,
    /// Dark colours.
    Dark,
    /// Light colours.
    Light,
    /// Everything larger.
    Larger,
    /// Everything smaller.
    Smaller,
    /// Everything as large as the screen asks for.
    UsualSize,
    /// Choose a command, image or point by typing.
    Palette,
    /// The list of keys.
    Keys,
}

/// Where a command stands in the bar above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Menu {
    File,
    /// Its entries name what they would take back.
    Edit,
    View,
    /// The lower part of the view menu.
    Panels,
    Help,
    /// In the bar itself: what runs stages.
    Bar,
}

impl Command {
    /// All commands, in the order of the menus.
    pub const ALL: [Command; 39] = [
        Command::New,
        Command::Open,
        Command::Demo,
        Command::SaveCopy,
        Command::FindPictures,
        Command::Close,
        Command::Quit,
        Command::Undo,
        Command::Redo,
        Command::NameByList,
        Command::Step,
        Command::RunStage,
        Command::RunAll,
        Command::Interrupt,
        Command::NextImage,
        Command::PreviousImage,
        Command::GoToSelection,
        Command::ImagePanels(1),
        Command::ImagePanels(2),
        Command::ImagePanels(4),
        Command::Show(Pane::Stages),
        Command::Show(Pane::Images),
        Command::Show(Pane::Network),
        Command::Show(Pane::Inspector),
        Command::Show(Pane::Frame),
        Command::Show(Pane::Findings),
        Command::Show(Pane::Review),
        Command::Show(Pane::Tables),
        Command::Show(Pane::Plots),
        Command::Show(Pane::Journal),
        Command::FirstLayout,
        Command::FitNetwork,
        Command::Dark,
        Command::Light,
        Command::Larger,
        Command::Smaller,
        Command::UsualSize,
        Command::Palette,
        Command::Keys,
    ];

    /// The commands of a menu, in their order.
    pub(super) fn of_menu(menu: Menu) -> impl Iterator<Item = Command> {
        let all = Self::ALL.into_iter();
        all.filter(move |command| command.menu() == menu)
    }

    fn menu(self) -> Menu {
        match self {
            Command::New
            | Command::Open
            | Command::Demo
            | Command::SaveCopy
            | Command::FindPictures
            | Command::Close
            | Command::Quit => Menu::File,
            Command::Undo | Command::Redo | Command::NameByList => Menu::Edit,
            Command::Step | Command::RunStage | Command::RunAll | Command::Interrupt => Menu::Bar,
            Command::Show(_) => Menu::Panels,
            Command::Palette | Command::Keys => Menu::Help,
            Command::NextImage
            | Command::PreviousImage
            | Command::GoToSelection
            | Command::ImagePanels(_)
            | Command::FirstLayout
            | Command::FitNetwork
            | Command::Dark
            | Command::Light
            | Command::Larger
            | Command::Smaller
            | Command::UsualSize => Menu::View,
        }
    }

    /// Whether a text field opens and takes the keyboard.
    pub(super) fn opens_a_field(self) -> bool {
        matches!(
            self,
            Command::New
                | Command::Open
                | Command::SaveCopy
                | Command::FindPictures
                | Command::NameByList
                | Command::Palette
        )
    }

    /// Its name.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Command::Step => "Step",
            Command::RunStage => "Run stage",
            Command::RunAll => "Run all",
            Command::Interrupt => "Interrupt",
            Command::Undo => "Undo",
            Command::Redo => "Redo",
            Command::New => "New project ...",
            Command::Open => "Open ...",
            Command::Demo => "Demo",
            Command::SaveCopy => "Save a copy ...",
            Command::FindPictures => "Find pictures ...",
            Command::NameByList => "Name targets by a list ...",
            Command::Close => "Close project",
            Command::Quit => "Quit",
            Command::NextImage => "Next image",
            Command::PreviousImage => "Previous image",
            Command::GoToSelection => "Go to selection",
            Command::ImagePanels(1) => "One image panel",
            Command::ImagePanels(2) => "Two image panels",
            Command::ImagePanels(_) => "Four image panels",
            Command::Show(pane) => pane.command(),
            Command::FirstLayout => "First layout",
            Command::FitNetwork => "Fit the 3D view",
            Command::Dark => "Dark colours",
            Command::Light => "Light colours",
            Command::Larger => "Larger",
            Command::Smaller => "Smaller",
            Command::UsualSize => "Usual size",
            Command::Palette => "Command palette",
            Command::Keys => "All keys",
        }
    }

    /// Its key.
    #[must_use]
    pub fn shortcut(self) -> Option<KeyboardShortcut> {
        let key = |modifiers, key| Some(KeyboardShortcut::new(modifiers, key));
        let (none, control) = (Modifiers::NONE, Modifiers::COMMAND);
        match self {
            Command::Step => key(none, Key::F5),
            Command::RunStage => key(Modifiers::SHIFT, Key::F5),
            Command::RunAll => key(control, Key::F5),
            Command::Interrupt => key(none, Key::Escape),
            Command::Undo => key(control, Key::Z),
            Command::Redo => key(control, Key::Y),
            Command::New => key(control, Key::N),
            Command::Open => key(control, Key::O),
            Command::SaveCopy => key(control | Modifiers::SHIFT, Key::S),
            Command::Close => key(control, Key::W),
            Command::Quit => key(control, Key::Q),
            Command::NextImage => key(none, Key::N),
            Command::PreviousImage => key(none, Key::P),
            Command::GoToSelection => key(none, Key::G),
            Command::ImagePanels(1) => key(control, Key::Num1),
            Command::ImagePanels(2) => key(control, Key::Num2),
            Command::ImagePanels(4) => key(control, Key::Num4),
            Command::Show(pane) => key(Modifiers::ALT, pane.key()?),
            Command::Palette => key(control, Key::K),
            Command::Keys => key(none, Key::Questionmark),
            // The zoom keys are egui's own: Ctrl and +, -, 0.
            _ => None,
        }
    }
}

/// A key of a view, for the list of keys.
pub(super) struct ViewKey {
    /// Where it works.
    pub(super) place: &'static str,
    /// The key.
    pub(super) keys: &'static str,
    /// What it does.
    pub(super) meaning: &'static str,
}

const fn view_key(place: &'static str, keys: &'static str, meaning: &'static str) -> ViewKey {
    ViewKey {
        place,
        keys,
        meaning,
    }
}

const IMAGE: &str = "Image, under the pointer";
const NETWORK: &str = "3D view, under the pointer";
const REVIEW: &str = "Review";

/// Keys that views take while the pointer is over them, or while they are in front.
pub(super) const VIEW_KEYS: [ViewKey; 29] = [
    view_key(IMAGE, "wheel", "zoom at the pointer"),
    view_key(IMAGE, "drag", "move the picture"),
    view_key(
        IMAGE,
        "W + drag, right drag",
        "window and level (contrast and brightness)",
    ),
    view_key(IMAGE, "0", "contrast for what is in sight"),
    view_key(IMAGE, "F", "whole picture"),
    view_key(IMAGE, "1", "one to one"),
    view_key(IMAGE, "Z", "loupe"),
    view_key(
        IMAGE,
        "L",
        "name the dot: list by predicted distance, Enter takes the first",
    ),
    view_key(
        IMAGE,
        "A",
        "measure where the target was missed, or at the next click",
    ),
    view_key(IMAGE, "X", "reject the dot"),
    view_key(IMAGE, "R", "restore the dot"),
    view_key(IMAGE, "Delete", "take the name away"),
    view_key(IMAGE, "N", "another number for the code"),
    view_key(NETWORK, "drag", "turn"),
    view_key(NETWORK, "Shift + drag, middle drag", "move"),
    view_key(NETWORK, "Ctrl + drag", "roll"),
    view_key(NETWORK, "wheel", "zoom at the pointer"),
    view_key(NETWORK, "+ and -", "zoom at the middle"),
    view_key(NETWORK, "B + drag", "select all points within a box"),
    view_key(NETWORK, "F", "fit"),
    view_key(NETWORK, "arrows", "turn"),
    view_key(NETWORK, "Shift + arrows", "move"),
    view_key(REVIEW, "Space", "accept"),
    view_key(
        REVIEW,
        "1 to 9",
        "this reading of an ambiguous group is right",
    ),
    view_key(REVIEW, "X", "reject"),
    view_key(REVIEW, "E", "edit: the list of labels of the dot"),
    view_key(REVIEW, "N", "next, decide later"),
    view_key(REVIEW, "Backspace", "back"),
    view_key(
        "Everywhere",
        "Ctrl + plus, minus, 0",
        "larger, smaller, usual size",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_and_no_name_means_two_things() {
        for (place, first) in Command::ALL.iter().enumerate() {
            for second in &Command::ALL[place + 1..] {
                assert_ne!(first.title(), second.title());
                let keys = (first.shortcut(), second.shortcut());
                assert!(
                    keys.0.is_none() || keys.0 != keys.1,
                    "{first:?} and {second:?}"
                );
            }
        }
    }
}
