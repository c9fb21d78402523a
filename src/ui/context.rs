//! What every panel may look at while it draws.

use super::action::Selection;
use super::pictures::PictureStore;
use crate::network::Network;

/// What every panel may look at; it changes nothing but its own small state, and asks for the rest by actions.
pub struct ViewContext<'a> {
    /// The document.
    pub network: &'a Network,
    /// Pictures that are decoded, or asked for by looking.
    pub pictures: &'a PictureStore,
    /// What is selected.
    pub selection: &'a Selection,
    /// How many edits wait for the end of the running step, and which dots they are about.
    pub pending: &'a [crate::project::edit::Edit],
}
