//! `targets.toml`: the sizes of the targets in use.

use std::fmt::Write;
use std::path::Path;

use super::FileError;
use super::error::{read_with, without_mark};
use super::keys::{Document, Keys};
use crate::network::{DotFamily, TargetSizes};
use crate::targets::Family;

/// Pitches and diameters that targets may have, mm.
const SIZE_MM: std::ops::RangeInclusive<f64> = 0.001..=10_000.0;
/// Two dots of a `dot420` code stand at least this many pitches apart; larger ones run together.
const LEAST_GAP_PITCHES: f64 = 2.0;

/// Reads the sizes of targets.
///
/// # Errors
/// [`FileError`], one line.
pub fn read_targets(path: &Path) -> Result<TargetSizes, FileError> {
    read_with(path, parse_targets)
}

/// The sizes in a text; `file` is its name in messages.
///
/// # Errors
/// [`FileError`], one line.
pub fn parse_targets(file: &str, text: &str) -> Result<TargetSizes, FileError> {
    let text = without_mark(text);
    let document = Document { file, text };
    let table = document.parse()?;
    let keys = document.keys(&table);
    keys.refuse_others(&["family", "plain"])?;
    let mut sizes = TargetSizes::default();
    if let Some(families) = keys.get("family") {
        for entry in families.tables()? {
            let family = dot_family(entry, &sizes)?;
            sizes.families.push(family);
        }
    }
    if let Some(plain) = keys.get("plain") {
        let plain = plain.table()?;
        plain.refuse_others(&["dot_mm"])?;
        if let Some(dot) = plain.get("dot_mm") {
            sizes.plain_dot_mm = dot.within(SIZE_MM, "mm")?;
        }
    }
    Ok(sizes)
}

fn dot_family(entry: Keys<'_>, before: &TargetSizes) -> Result<DotFamily, FileError> {
    entry.refuse_others(&["name", "pitch_mm", "dot_mm"])?;
    let name = entry.required("name")?;
    let known = || Family::ALL.map(|f| f.to_string()).join(", ");
    let family: Family = name
        .text()?
        .parse()
        .map_err(|_| name.expected(format!("one of {}", known())))?;
    if before.families.iter().any(|f| f.family == family) {
        return Err(name.unexpected(format!("the family {family} again"), "it once"));
    }
    let mut sizes = TargetSizes::default().of(family);
    if let Some(pitch) = entry.get("pitch_mm") {
        sizes.pitch_mm = pitch.within(SIZE_MM, "mm")?;
    }
    if let Some(dot) = entry.get("dot_mm") {
        sizes.dot_mm = dot.within(SIZE_MM, "mm")?;
    }
    let most = LEAST_GAP_PITCHES * sizes.pitch_mm;
    if family == Family::Dot420 && sizes.dot_mm >= most {
        return Err(name.unexpected(
            format!(
                "dots of {} mm in a code of pitch {} mm",
                sizes.dot_mm, sizes.pitch_mm
            ),
            format!("dots smaller than {most} mm, as larger ones run together"),
        ));
    }
    Ok(sizes)
}

/// The text of a targets file.
#[must_use]
pub fn targets_toml(sizes: &TargetSizes) -> String {
    let mut text = String::new();
    for family in &sizes.families {
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "[[family]]\nname = \"{}\"\npitch_mm = {:?}\ndot_mm = {:?}\n\n",
            family.family, family.pitch_mm, family.dot_mm
        );
    }
    let _ = write!(text, "[plain]\ndot_mm = {:?}\n", sizes.plain_dot_mm);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_they_are_written() {
        let sizes = TargetSizes {
            families: vec![
                DotFamily {
                    family: Family::Dot420,
                    pitch_mm: 4.0,
                    dot_mm: 3.5,
                },
                DotFamily {
                    family: Family::Ring(14),
                    pitch_mm: 5.0,
                    dot_mm: 8.0,
                },
            ],
            plain_dot_mm: 6.25,
        };
        assert_eq!(parse_targets("t.toml", &targets_toml(&sizes)), Ok(sizes));
        assert_eq!(parse_targets("t.toml", ""), Ok(TargetSizes::default()));
    }

    #[test]
    fn what_is_not_given_is_five_millimetres() {
        let sizes = parse_targets("t.toml", "[[family]]\nname = 'dot420'\ndot_mm = 6\n").unwrap();
        assert_eq!(sizes.families[0].pitch_mm, 5.0);
        assert_eq!(sizes.plain_dot_mm, 5.0);
    }

    #[test]
    fn bad_files_are_answered_in_one_line() {
        for (text, line) in [
            (
                "plain = 3",
                "t.toml, line 1, column 9: found 'plain = 3', expected a table [plain]",
            ),
            (
                "[family]\nname = 'dot420'",
                "t.toml, line 1, column 1: found the table family, expected tables [[family]]",
            ),
            (
                "[[family]]\ndot_mm = 3",
                "t.toml, line 1, column 1: found no key name, expected it",
            ),
            (
                "[[family]]\nname = 'ring13'",
                "t.toml, line 2, column 8: found 'name = 'ring13'', expected one of dot420, ring12, ring14, ring20",
            ),
            (
                "[[family]]\nname = 'ring12'\n[[family]]\nname = 'ring12'",
                "t.toml, line 4, column 8: found the family ring12 again, expected it once",
            ),
            (
                "[[family]]\nname = 'ring12'\nsize = 3",
                "t.toml, line 3, column 1: found the key 'size', expected one of name, pitch_mm, dot_mm",
            ),
            (
                "[plain]\ndot_mm = 0",
                "t.toml, line 2, column 10: found 'dot_mm = 0', expected a number from 0.001 to 10000 (mm)",
            ),
            (
                "[plain]\ndot = 3",
                "t.toml, line 2, column 1: found the key 'dot', expected one of dot_mm",
            ),
            (
                "[[family]]\nname = 'dot420'\npitch_mm = 5\ndot_mm = 12",
                "t.toml, line 2, column 8: found dots of 12 mm in a code of pitch 5 mm, expected dots smaller than 10 mm, as larger ones run together",
            ),
        ] {
            let error = parse_targets("t.toml", text).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
    }
}
