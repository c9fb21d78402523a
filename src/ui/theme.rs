//! Colours with a meaning, the same in images, 3D view and tables: the set of Okabe and Ito (2008), safe for
//! colour-blind eyes.

use egui::Color32;

/// A dot that the adjustment uses.
pub const USED: Color32 = Color32::from_rgb(86, 180, 233);
/// A dot of a coded target.
pub const CODE: Color32 = Color32::from_rgb(0, 158, 115);
/// A dot without a name, or a doubtful one.
pub const DOUBTFUL: Color32 = Color32::from_rgb(230, 159, 0);
/// A rejected dot or candidate.
pub const REJECTED: Color32 = Color32::from_rgb(213, 94, 0);
/// Where a target should be that was not found.
pub const PREDICTED: Color32 = Color32::from_rgb(204, 121, 167);
/// What is selected.
pub const SELECTED: Color32 = Color32::from_rgb(240, 228, 66);
