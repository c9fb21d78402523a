//! Lists, tables, plots and the inspector around the views.
//!
//! Every panel draws from the network alone and asks by [`super::action::Action`]. What costs time is computed once per
//! state of the network and kept until one of its parts is another (`Arc::ptr_eq`). Numbers of an adjustment that is older than the
//! inputs are drawn faded, with words that say so.

mod basis;
mod facts;
mod stale;

pub mod findings;
pub mod frame;
pub mod images;
pub mod inspector;
pub mod journal;
pub mod plots;
pub mod review;
pub mod stages;
pub mod tables;

#[cfg(test)]
mod fixture;

pub(in crate::ui) use facts::mark;
