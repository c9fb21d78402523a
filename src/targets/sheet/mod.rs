//! Sheets of targets for a printer: what lies where on the pages, in millimetres.
//!
//! A page is a list of shapes, and that list is all that the writers of files know: whatever is drawn, true to size, is
//! decided here. A code stands in the middle of a dark patch, at least one dot or pitch of which surrounds it, so that
//! every dot has the ground its measurement needs and the codes of neighbouring tiles stay more than three pitches
//! away. Its number is printed below the patch and not on it, dark on light where the targets are light: light figures
//! beside a code would be found as small dots.
//!
//! `dot420` codes stand with A to the right of O and B above it (Hattori et al., 2002). Ring codes have their first,
//! most significant segment clockwise from straight up, between two and three radii of the dot.
//!
//! Invariant: a pure function of its settings; no file is known here.

mod grid;
mod ids;
mod layout;
mod marks;
mod shape;

pub use ids::{IdList, UnreadableIds};
pub use layout::{SheetError, SheetSettings, sheet};
pub(crate) use shape::on_circle;
pub use shape::{PAGE_HEIGHT_MM, PAGE_WIDTH_MM, Page, Shape, Sheet, Tone};
