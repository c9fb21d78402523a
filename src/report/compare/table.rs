//! The comparison for people.

use std::fmt::Write;

use super::{Agreement, Comparison};

/// Most names that are told one by one.
const MOST_NAMES: usize = 12;

impl Comparison {
    /// A table of a few lines.
    #[must_use]
    pub fn text(&self) -> String {
        let parameters = if self.with_scale {
            format!("seven parameters, scale {:.8}", self.scale)
        } else {
            "six parameters, scale kept at 1".to_owned()
        };
        let mut text = format!(
            "best fit onto the reference: {parameters}; scale of the measurement from {}\n",
            self.scale_from
        );
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:<22}{:>7}{:>11}{:>11}{:>11}{:>11}{:>12}  {:<10}{:>11}",
            "mm", "points", "rms x", "rms y", "rms z", "rms all", "largest", "at", "rms/sigma"
        );
        text.push_str(&row("by label", &self.by_label));
        if self.by_place.points > 0 {
            let name = format!("by place (< {:.2} mm)", self.place_distance_mm);
            text.push_str(&row(&name, &self.by_place));
        }
        for (what, names) in [
            ("reference points", &self.reference_without_counterpart),
            ("adjusted points", &self.points_without_counterpart),
        ] {
            if !names.is_empty() {
                let more = if names.len() > MOST_NAMES { " .." } else { "" };
                let shown = names[..names.len().min(MOST_NAMES)].join(" ");
                let _ = writeln!(
                    text,
                    "{} {what} without a counterpart: {shown}{more}",
                    names.len()
                );
            }
        }
        text
    }
}

fn row(name: &str, agreement: &Agreement) -> String {
    let mm = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
    let ratio = agreement
        .rms_over_sigma
        .map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    format!(
        "{name:<22}{:>7}{:>11}{:>11}{:>11}{:>11}{:>12}  {:<10}{ratio:>11}\n",
        agreement.points,
        mm(agreement.rms_x_mm),
        mm(agreement.rms_y_mm),
        mm(agreement.rms_z_mm),
        mm(agreement.rms_mm),
        mm(agreement.largest_mm),
        agreement.largest_label.as_deref().unwrap_or("-"),
    )
}
