//! The names for people.

use std::fmt::Write;

use super::outcome::{Ambiguity, Rival};
use super::{Naming, Way};
use crate::report::compare::Agreement;

/// Most lines of one kind that are told one by one.
const MOST_LINES: usize = 20;

impl Naming {
    /// A table of a few lines, and a line for every reference point that is doubtful or left.
    #[must_use]
    pub fn text(&self) -> String {
        let way = match self.way {
            Way::Labels => "labels in common",
            Way::Frame => "standing in one frame",
            Way::Geometry => "geometry alone",
        };
        let parameters = if self.with_scale {
            format!("seven parameters, scale {:.8}", self.scale)
        } else {
            "six parameters, scale kept at 1".to_owned()
        };
        let mut text = format!(
            "transformation onto the reference: first by {way}; {parameters}; scale of the measurement from {}\n",
            self.scale_from
        );
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:<22}{:>7}{:>11}{:>12}  {:<10}",
            "mm", "points", "rms", "largest", "at"
        );
        text.push_str(&row("fit", &self.fit));
        text.push_str(&row("named", &self.named));
        let _ = writeln!(text, "{:<22}{:>7}", "had their name", self.named_before);
        section(
            &mut text,
            "ambiguous",
            self.ambiguous.iter().map(both_candidates),
        );
        let off = self.labels_off.iter();
        section(
            &mut text,
            "common labels off, not used",
            off.map(|d| format!("{} lies {:.3} mm off", d.label, d.distance_mm)),
        );
        let left = self.reference_left.iter();
        section(
            &mut text,
            "reference points gave no name",
            left.map(|left| format!("{} {}", left.reference, left.why)),
        );
        let targets = self.targets_left.iter();
        section(
            &mut text,
            "targets at no known place",
            targets.map(|left| match (&left.nearest, left.distance_mm) {
                (Some(nearest), Some(distance)) => {
                    format!("{} ({nearest} in {distance:.3} mm)", left.target)
                }
                _ => left.target.clone(),
            }),
        );
        let _ = writeln!(
            text,
            "a point is at a known place within {:.3} mm",
            self.within_mm
        );
        text
    }
}

fn section(text: &mut String, title: &str, lines: impl ExactSizeIterator<Item = String>) {
    let count = lines.len();
    if count == 0 {
        return;
    }
    let _ = writeln!(text, "{count} {title}:");
    for line in lines.take(MOST_LINES) {
        let _ = writeln!(text, "  {line}");
    }
    if count > MOST_LINES {
        let _ = writeln!(text, "  .. and {} more", count - MOST_LINES);
    }
}

fn both_candidates(found: &Ambiguity) -> String {
    let Ambiguity {
        reference,
        point,
        distance_mm,
        rival,
    } = found;
    match rival {
        Rival::Point {
            label,
            distance_mm: other,
        } => {
            format!("{reference}: {point} in {distance_mm:.3} mm or {label} in {other:.3} mm")
        }
        Rival::Reference {
            label,
            distance_mm: other,
        } => {
            format!("{point}: {reference} in {distance_mm:.3} mm or {label} in {other:.3} mm")
        }
    }
}

fn row(name: &str, agreement: &Agreement) -> String {
    let mm = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
    format!(
        "{name:<22}{:>7}{:>11}{:>12}  {:<10}\n",
        agreement.points,
        mm(agreement.rms_mm),
        mm(agreement.largest_mm),
        agreement.largest_label.as_deref().unwrap_or("-"),
    )
}
