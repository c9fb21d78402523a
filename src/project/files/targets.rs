//! `targets.toml`: the sizes of the targets in use, and what warmth does to the object that carries them.

use std::fmt::Write;
use std::path::Path;

use super::FileError;
use super::error::{read_with, without_mark};
use super::keys::{Document, Keys};
use crate::network::{DotFamily, Expansion, REFERENCE_CELSIUS, TargetSizes};
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
    keys.refuse_others(&["family", "plain", "object"])?;
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
    if let Some(object) = keys.get("object") {
        sizes.object = Some(expansion(object.table()?)?);
    }
    Ok(sizes)
}

/// The temperatures and the coefficient of the object.
fn expansion(object: Keys<'_>) -> Result<Expansion, FileError> {
    object.refuse_others(&["temperature_c", "reference_c", "expansion_per_k"])?;
    let temperature = object.required("temperature_c")?;
    let per_k = object.required("expansion_per_k")?;
    Ok(Expansion {
        per_k: per_k.within(Expansion::PER_K, "1/K")?,
        temperature_c: temperature.within(Expansion::CELSIUS, "C")?,
        reference_c: match object.get("reference_c") {
            Some(reference) => reference.within(Expansion::CELSIUS, "C")?,
            None => REFERENCE_CELSIUS,
        },
    })
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
    if let Some(object) = &sizes.object {
        let _ = write!(
            text,
            "\n[object]\ntemperature_c = {:?}\nreference_c = {:?}\nexpansion_per_k = {:?}\n",
            object.temperature_c, object.reference_c, object.per_k
        );
    }
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
            object: Some(Expansion {
                per_k: 23e-6,
                temperature_c: 27.5,
                reference_c: 21.0,
            }),
        };
        assert_eq!(parse_targets("t.toml", &targets_toml(&sizes)), Ok(sizes));
        assert_eq!(parse_targets("t.toml", ""), Ok(TargetSizes::default()));
    }

    #[test]
    fn what_is_not_given_is_five_millimetres() {
        let sizes = parse_targets("t.toml", "[[family]]\nname = 'dot420'\ndot_mm = 6\n").unwrap();
        assert_eq!(sizes.families[0].pitch_mm, 5.0);
        assert_eq!(sizes.plain_dot_mm, 5.0);
        assert_eq!(sizes.object, None);
        let object = "[object]\ntemperature_c = 31\nexpansion_per_k = 23e-6\n";
        let object = parse_targets("t.toml", object).unwrap().object.unwrap();
        assert_eq!((object.reference_c, object.temperature_c), (20.0, 31.0));
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
                "[object]\ntemperature_c = 30\nexpansion_per_k = 23",
                "t.toml, line 3, column 19: found 'expansion_per_k = 23', expected a number from -0.0005 to 0.0005 (1/K)",
            ),
            (
                "[object]\ntemperature_c = -300\nexpansion_per_k = 23e-6",
                "t.toml, line 2, column 17: found 'temperature_c = -300', expected a number from -273.15 to 1000 (C)",
            ),
            (
                "[object]\nexpansion_per_k = 23e-6",
                "t.toml, line 1, column 1: found no key temperature_c, expected it",
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
