//! `bars.csv`: known distances.

use std::path::Path;

use super::error::read_with;
use super::table::{Columns, Field, OtherColumns, Table};
use super::{FileError, expected_label, point_of_label};
use crate::network::{BarRole, DevicePoint, PointId, ScaleBar};
use crate::report::csv_text;

const COLUMNS: Columns = Columns {
    required: &["name", "from", "to", "length_mm", "sigma_mm"],
    optional: &["use"],
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

/// The text of a bars file.
#[must_use]
pub fn bars_csv(bars: &[ScaleBar]) -> String {
    csv_text(
        "name,from,to,length_mm,sigma_mm,use",
        bars.iter().map(|bar| {
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
        };
        let bars = vec![
            bar("long, red", "C17", "C18.A", BarRole::Control),
            bar("B2", "X1", "R14-5", BarRole::Check),
        ];
        assert_eq!(parse_bars("b.csv", &bars_csv(&bars), &device()), Ok(bars));
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
            "b.csv, line 1: found no column sigma_mm in the header 'name,from,to,length_mm', expected name,from,to,length_mm,sigma_mm[,use]"
        );
    }
}
