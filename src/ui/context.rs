//! What every panel may look at while it draws.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::action::Selection;
use super::pictures::PictureStore;
use crate::network::{Network, PointId};

/// What every panel may look at; it changes nothing but its own small state, and asks for the rest by actions.
pub struct ViewContext<'a> {
    /// The document.
    pub network: &'a Network,
    /// Pictures that are decoded, or asked for by looking.
    pub pictures: &'a PictureStore,
    /// What is selected.
    pub selection: &'a Selection,
    /// Points of the last box select; empty where there is none.
    pub group: &'a Arc<BTreeSet<PointId>>,
    /// How many edits wait for the end of the running step, and which dots they are about.
    pub pending: &'a [crate::project::edit::Edit],
}
