//! Numbers that are older than the operator's last edits never look like fresh ones.

use egui::Ui;

use crate::network::Network;

/// Opacity of numbers that are older than the inputs.
const FADED: f32 = 0.65;

/// What stands above them.
pub(super) const BEFORE_LAST_EDITS: &str = "before your last edits";

/// Whether there is an adjustment, but an older one than the inputs.
pub(super) fn is_stale(network: &Network) -> bool {
    network.adjustment.is_some() && !network.adjustment_is_fresh()
}

/// Draws what an adjustment gave: as it is where it is fresh, else faded and with words that say so.
pub(super) fn from_adjustment<R>(
    ui: &mut Ui,
    network: &Network,
    draw: impl FnOnce(&mut Ui) -> R,
) -> R {
    if !is_stale(network) {
        return draw(ui);
    }
    ui.weak(BEFORE_LAST_EDITS)
        .on_hover_text("The adjustment is older than the measurements. Run it again.");
    ui.scope(|ui| {
        ui.multiply_opacity(FADED);
        draw(ui)
    })
    .inner
}
