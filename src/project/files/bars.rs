//! `bars.csv`: known distances.

use std::path::Path;

use super::error::read_with;
use super::table::{Columns, Field, Line, OtherColumns, Table};
use super::{FileError, expected_label, point_of_label};
use crate::network::{BarRole, DevicePoint, Expansion, PointId, REFERENCE_CELSIUS, ScaleBar};
use crate::report::csv_text;

const COLUMNS: Columns = Columns {
    required: &["name", "from", "to", "length_mm", "sigma_mm"],
    optional: &["use", "temperature_c", "calibrated_at_c", "expansion_per_k"],
    others: OtherColumns::Refused,
};

/// Reads scale bars; `device` gives the labels of the cross.
///
/// # Errors
/// [`FileError`], one line.
pub fn read_bars(path: &Path, device: &[DevicePoint]) -> Result<Vec<ScaleBar>, FileError> {
    read_with(path, |file, text| parse_bars(file, text, device))
}

/// The scale bars of a text; `file` is its name in messages, `device` gives the labels of the cross.
///
/// # Errors
/// [`FileError`], one line.
pub fn parse_bars(
    file: &str,
    text: &str,
    device: &[DevicePoint],
) -> Result<Vec<ScaleBar>, FileError> {
    let table = Table::parse(file, text, COLUMNS)?;
    let mut bars: Vec<ScaleBar> = Vec::new();
    for line in table.lines() {
        let name = line.required("name")?;
        let (from, to) = (line.required("from")?, line.required("to")?);
        if end(from, device)? == end(to, device)? {
            let found = format!("a bar from {} to {}", from.text, to.text);
            return Err(to.unexpected(found, "two points"));
        }
        let sigma = line.required("sigma_mm")?;
        let bar = ScaleBar {
            name: name.name()?.to_owned(),
            from: from.text.to_owned(),
            to: to.text.to_owned(),
            length_mm: line.required("length_mm")?.positive()?,
            sigma_mm: sigma.positive()?,
            role: line.field("use").map_or(Ok(BarRole::Control), role)?,
            expansion: expansion(line)?,
        };
        if bar.sigma_mm >= bar.length_mm {
            return Err(sigma.expected("less than the length of the bar"));
        }
        if bars.iter().any(|other| other.name == bar.name) {
            return Err(name.unexpected(format!("the bar {} again", bar.name), "it once"));
        }
        bars.push(bar);
    }
    Ok(bars)
}

fn end(field: Field<'_>, device: &[DevicePoint]) -> Result<PointId, FileError> {
    point_of_label(device, field.text).map_err(|_| field.expected(expected_label(device)))
}

fn role(field: Field<'_>) -> Result<BarRole, FileError> {
    match field.text {
        "" | "control" => Ok(BarRole::Control),
        "check" => Ok(BarRole::Check),
        _ => Err(field.expected("control or check")),
    }
}

/// What warmth did to the bar of a line: its temperature and its coefficient together, or nothing.
fn expansion(line: Line<'_>) -> Result<Option<Expansion>, FileError> {
    let fields = ["temperature_c", "expansion_per_k", "calibrated_at_c"].map(|name| {
        let field = line.field(name);
        field.filter(|field| !field.text.is_empty())
    });
    let alone = |field: Field<'_>, expected: &str| {
        Err(field.expected(format!("{expected} with it, or nothing here")))
    };
    match fields {
        [Some(temperature), Some(per_k), calibrated_at] => Ok(Some(Expansion {
            per_k: per_k.within(Expansion::PER_K)?,
            temperature_c: temperature.within(Expansion::CELSIUS)?,
            reference_c: match calibrated_at {
                Some(field) => field.within(Expansion::CELSIUS)?,
                None => REFERENCE_CELSIUS,
            },
        })),
        [Some(temperature), None, _] => alone(temperature, "expansion_per_k"),
        [None, Some(per_k), _] => alone(per_k, "temperature_c"),
        [None, None, Some(at)] => alone(at, "temperature_c and expansion_per_k"),
        [None, None, None] => Ok(None),
    }
}

/// The text of a bars file; temperatures have columns where they are known of a bar.
#[must_use]
pub fn bars_csv(bars: &[ScaleBar]) -> String {
    let header = "name,from,to,length_mm,sigma_mm,use";
    let row = |bar: &ScaleBar| {
        let role = match bar.role {
            BarRole::Control => "control",
            BarRole::Check => "check",
        };
        vec![
            bar.name.clone(),
            bar.from.clone(),
            bar.to.clone(),
            bar.length_mm.to_string(),
            bar.sigma_mm.to_string(),
            role.to_owned(),
        ]
    };
    if bars.iter().all(|bar| bar.expansion.is_none()) {
        return csv_text(header, bars.iter().map(row));
    }
    csv_text(
        &format!("{header},temperature_c,calibrated_at_c,expansion_per_k"),
        bars.iter().map(|bar| {
            let known = |value: fn(&Expansion) -> f64| {
                let value = bar.expansion.as_ref().map(value);
                value.map_or_else(String::new, |value| value.to_string())
            };
            let mut row = row(bar);
            row.extend([
                known(|bar| bar.temperature_c),
                known(|bar| bar.reference_c),
                known(|bar| bar.per_k),
            ]);
            row
        }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device() -> Vec<DevicePoint> {
        ["X1", "X2"]
            .map(|label| DevicePoint {
                label: label.into(),
                position_mm: [0.0; 3],
            })
            .into()
    }

    #[test]
    fn bars_are_read_as_they_are_written() {
        let bar = |name: &str, from: &str, to: &str, role| ScaleBar {
            name: name.into(),
            from: from.into(),
            to: to.into(),
            length_mm: 1000.0 / 7.0,
            sigma_mm: 0.003,
            role,
            expansion: None,
        };
        let bars = vec![
            bar("long, red", "C17", "C18.A", BarRole::Control),
            bar("B2", "X1", "R14-5", BarRole::Check),
        ];
        let text = bars_csv(&bars);
        assert!(!text.contains("temperature_c"), "{text}");
        assert_eq!(parse_bars("b.csv", &text, &device()), Ok(bars.clone()));
        let mut warm = bars;
        warm[1].expansion = Some(Expansion {
            per_k: 11.5e-6,
            temperature_c: 27.3,
            reference_c: 21.0,
        });
        assert_eq!(parse_bars("b.csv", &bars_csv(&warm), &device()), Ok(warm));
    }

    #[test]
    fn a_warm_bar_is_calibrated_at_twenty_degrees_where_nothing_is_said() {
        let text = "name,from,to,length_mm,sigma_mm,temperature_c,expansion_per_k\nB,M1,M2,500,0.1,30,11.5e-6\nD,M1,M2,500,0.1,,\n";
        let bars = parse_bars("b.csv", text, &[]).unwrap();
        let known = Expansion {
            per_k: 11.5e-6,
            temperature_c: 30.0,
            reference_c: 20.0,
        };
        assert_eq!((bars[0].expansion, bars[1].expansion), (Some(known), None));
    }

    #[test]
    fn bad_temperatures_are_answered_in_one_line() {
        for (row, line) in [
            (
                "-273.2,20,11.5e-6",
                "b.csv, line 2, column 6 (temperature_c): found '-273.2', expected a number from -273.15 to 1000",
            ),
            (
                "30,nan,11.5e-6",
                "b.csv, line 2, column 7 (calibrated_at_c): found 'nan', expected a finite number",
            ),
            (
                "30,20,11.5",
                "b.csv, line 2, column 8 (expansion_per_k): found '11.5', expected a number from -0.0005 to 0.0005",
            ),
            (
                "30,20,",
                "b.csv, line 2, column 6 (temperature_c): found '30', expected expansion_per_k with it, or nothing here",
            ),
            (
                ",,11.5e-6",
                "b.csv, line 2, column 8 (expansion_per_k): found '11.5e-6', expected temperature_c with it, or nothing here",
            ),
        ] {
            let header =
                "name,from,to,length_mm,sigma_mm,temperature_c,calibrated_at_c,expansion_per_k";
            let text = format!("{header}\nB,C1,C2,500,0.1,{row}\n");
            let error = parse_bars("b.csv", &text, &device()).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
    }

    #[test]
    fn a_bar_is_for_control_where_nothing_is_said() {
        for text in [
            "name,from,to,length_mm,sigma_mm\nB,M1,M2,500,0.1",
            "name,from,to,length_mm,sigma_mm,use\nB,M1,M2,500,0.1,\n",
        ] {
            assert_eq!(
                parse_bars("b.csv", text, &[]).unwrap()[0].role,
                BarRole::Control
            );
        }
    }

    #[test]
    fn bad_files_are_answered_in_one_line() {
        for (rows, line) in [
            (
                "B,C1,C2,abc,0.1,",
                "b.csv, line 2, column 4 (length_mm): found 'abc', expected a number",
            ),
            (
                "B,C1,C2,0,0.1,",
                "b.csv, line 2, column 4 (length_mm): found '0', expected a number greater than 0",
            ),
            (
                "B,C1,C2,-5,0.1,",
                "b.csv, line 2, column 4 (length_mm): found '-5', expected a number greater than 0",
            ),
            (
                "B,C1,C2,5,0,",
                "b.csv, line 2, column 5 (sigma_mm): found '0', expected a number greater than 0",
            ),
            (
                "B,C1,C2,5,5,",
                "b.csv, line 2, column 5 (sigma_mm): found '5', expected less than the length of the bar",
            ),
            (
                "B,C1,C1.O,5,0.1,",
                "b.csv, line 2, column 3 (to): found a bar from C1 to C1.O, expected two points",
            ),
            (
                "B,C1,C421,5,0.1,",
                "b.csv, line 2, column 3 (to): found 'C421', expected the label of a point such as C17, C17.A, R14-57, M5 or a dot of the cross (X1 .. X2)",
            ),
            (
                "B,X3,C1,5,0.1,",
                "b.csv, line 2, column 2 (from): found 'X3', expected the label of a point such as C17, C17.A, R14-57, M5 or a dot of the cross (X1 .. X2)",
            ),
            (
                "B,C1,C2,5,0.1,maybe",
                "b.csv, line 2, column 6 (use): found 'maybe', expected control or check",
            ),
            (
                ",C1,C2,5,0.1,",
                "b.csv, line 2, column 1 (name): found nothing, expected a name",
            ),
            (
                "B,C1,C2,5,0.1,\nB,C1,C3,5,0.1,",
                "b.csv, line 3, column 1 (name): found the bar B again, expected it once",
            ),
            (
                "B,C1,C2,5,0.1",
                "b.csv, line 2: found 5 fields, expected 6 (name,from,to,length_mm,sigma_mm,use)",
            ),
        ] {
            let text = format!("name,from,to,length_mm,sigma_mm,use\n{rows}\n");
            let error = parse_bars("b.csv", &text, &device()).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
        let error = parse_bars("b.csv", "name,from,to,length_mm\n", &[]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "b.csv, line 1: found no column sigma_mm in the header 'name,from,to,length_mm', expected name,from,to,length_mm,sigma_mm[,use][,temperature_c][,calibrated_at_c][,expansion_per_k]"
        );
    }
}
