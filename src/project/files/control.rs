//! `control.csv` and `reference.csv`: known coordinates, to use or to compare with.

use std::collections::BTreeSet;
use std::path::Path;

use super::error::{Place, read_with};
use super::table::{Columns, Field, Line, OtherColumns, Table, header_names};
use super::{FileError, expected_label, point_of_label};
use crate::network::{ControlPoint, ControlRole, DevicePoint};
use crate::report::{ReferencePoint, csv_text};
use crate::targets::Family;

const SIGMAS_AND_ROLE: &[&str] = &["sigma_x_mm", "sigma_y_mm", "sigma_z_mm", "role"];

const CONTROL: Columns = Columns {
    required: &["label", "x_mm", "y_mm", "z_mm"],
    optional: SIGMAS_AND_ROLE,
    others: OtherColumns::Refused,
};

/// A reference changes nothing in the measurement, so that tables with more columns may serve: our own export is one.
const REFERENCE: Columns = Columns {
    others: OtherColumns::Ignored,
    ..CONTROL
};

/// Numbered points of several kinds, as other programs write them.
const NUMBERED: Columns = Columns {
    required: &["number", "kind", "x_mm", "y_mm", "z_mm"],
    optional: &["sigma_x_mm", "sigma_y_mm", "sigma_z_mm"],
    others: OtherColumns::Ignored,
};

/// Reads points with known coordinates; `device` gives the labels of the cross.
///
/// # Errors
/// [`FileError`], one line.
pub fn read_control(path: &Path, device: &[DevicePoint]) -> Result<Vec<ControlPoint>, FileError> {
    read_with(path, |file, text| parse_control(file, text, device))
}

/// The points with known coordinates of a text; `file` is its name in messages, `device` gives the labels of the cross.
///
/// In a table of numbered points those of a kind without code are passed over: no label says which they are.
///
/// # Errors
/// [`FileError`], one line.
pub fn parse_control(
    file: &str,
    text: &str,
    device: &[DevicePoint],
) -> Result<Vec<ControlPoint>, FileError> {
    if is_numbered(text) {
        let points: Vec<ControlPoint> = numbered(file, text)?
            .into_iter()
            .filter_map(|point| {
                let label = point.label?;
                point_of_label(&[], &label).ok()?;
                Some(ControlPoint {
                    label,
                    coordinates_mm: point.coordinates_mm,
                    sigmas_mm: point.sigmas_mm,
                    role: ControlRole::Align,
                })
            })
            .collect();
        if points.is_empty() {
            return Err(FileError::unexpected(
                file,
                Place::File,
                "no point of a code family",
                "a kind such as ring14 or dot420",
            ));
        }
        return Ok(points);
    }
    let table = Table::parse(file, text, CONTROL)?;
    let mut seen = BTreeSet::new();
    let mut points = Vec::new();
    for line in table.lines() {
        let label = line.required("label")?;
        let id = point_of_label(device, label.text)
            .map_err(|_| label.expected(expected_label(device)))?;
        if !seen.insert(id) {
            return Err(label.unexpected(format!("the label {} again", label.text), "it once"));
        }
        let point = ControlPoint {
            label: label.text.to_owned(),
            coordinates_mm: coordinates(line)?,
            sigmas_mm: sigmas(line)?,
            role: line.field("role").map_or(Ok(ControlRole::Align), role)?,
        };
        check_weights(line, &point)?;
        points.push(point);
    }
    Ok(points)
}

/// Reads the coordinates to compare with.
///
/// # Errors
/// [`FileError`], one line.
pub fn read_reference(path: &Path) -> Result<Vec<ReferencePoint>, FileError> {
    read_with(path, parse_reference)
}

/// The coordinates to compare with of a text; `file` is its name in messages.
///
/// Labels may be of other programs: which of them name points is the network's to say.
///
/// # Errors
/// [`FileError`], one line.
pub fn parse_reference(file: &str, text: &str) -> Result<Vec<ReferencePoint>, FileError> {
    if is_numbered(text) {
        return numbered(file, text);
    }
    let table = Table::parse(file, text, REFERENCE)?;
    let mut seen = BTreeSet::new();
    let mut points = Vec::new();
    for line in table.lines() {
        let label = line.required("label")?;
        if !label.text.is_empty() && !seen.insert(same_point(label.text)) {
            return Err(label.unexpected(format!("the label {} again", label.text), "it once"));
        }
        let named = !label.text.is_empty();
        points.push(ReferencePoint {
            label: named.then(|| label.text.to_owned()),
            name: if named {
                label.text.to_owned()
            } else {
                format!("line {}", line.number())
            },
            coordinates_mm: coordinates(line)?,
            sigmas_mm: sigmas(line)?,
        });
    }
    Ok(points)
}

/// The same text for `C17` and `C17.O`.
fn same_point(label: &str) -> String {
    point_of_label(&[], label).map_or_else(|_| label.to_owned(), |id| id.to_string())
}

fn is_numbered(text: &str) -> bool {
    let header = header_names(text);
    let has = |name: &str| header.iter().any(|n| n == name);
    has("number") && has("kind") && !has("label")
}

fn numbered(file: &str, text: &str) -> Result<Vec<ReferencePoint>, FileError> {
    let table = Table::parse(file, text, NUMBERED)?;
    let mut seen = BTreeSet::new();
    let mut points = Vec::new();
    for line in table.lines() {
        let (number, kind) = (line.required("number")?, line.required("kind")?);
        let name = match kind.text.parse::<Family>() {
            Err(_) => format!("{} {}", kind.text, number.text),
            Ok(family) => code_label(number, family)?,
        };
        if !seen.insert(name.clone()) {
            return Err(number.unexpected(format!("the point {name} again"), "it once"));
        }
        points.push(ReferencePoint {
            label: Some(name.clone()),
            name,
            coordinates_mm: coordinates(line)?,
            sigmas_mm: sigmas(line)?,
        });
    }
    Ok(points)
}

fn code_label(number: Field<'_>, family: Family) -> Result<String, FileError> {
    let count = family.code_count();
    number
        .text
        .parse::<u32>()
        .ok()
        .filter(|code| (1..=count).contains(code))
        .map(|code| family.code_label(code))
        .ok_or_else(|| number.expected(format!("the number of a {family} code from 1 to {count}")))
}

fn coordinates(line: Line<'_>) -> Result<[Option<f64>; 3], FileError> {
    Ok([
        line.required("x_mm")?.number_or_nothing()?,
        line.required("y_mm")?.number_or_nothing()?,
        line.required("z_mm")?.number_or_nothing()?,
    ])
}

fn sigmas(line: Line<'_>) -> Result<[Option<f64>; 3], FileError> {
    let mut sigmas = [None; 3];
    for (sigma, name) in sigmas.iter_mut().zip(SIGMAS_AND_ROLE) {
        if let Some(field) = line.field(name) {
            *sigma = field.positive_or_nothing()?;
        }
    }
    Ok(sigmas)
}

fn role(field: Field<'_>) -> Result<ControlRole, FileError> {
    match field.text {
        "" | "align" => Ok(ControlRole::Align),
        "weighted" => Ok(ControlRole::Weighted),
        "fixed" => Ok(ControlRole::Fixed),
        "check" => Ok(ControlRole::Check),
        _ => Err(field.expected("align, weighted, fixed or check")),
    }
}

/// A point must have a coordinate, and a weighted one a sigma for each.
fn check_weights(line: Line<'_>, point: &ControlPoint) -> Result<(), FileError> {
    let known = point.coordinates_mm.map(|c| c.is_some());
    if known == [false; 3] {
        let found = format!("no coordinate of {}", point.label);
        return Err(line.required("x_mm")?.unexpected(found, "at least one"));
    }
    let missing = (0..3).find(|&axis| known[axis] && point.sigmas_mm[axis].is_none());
    match (point.role, missing) {
        (ControlRole::Weighted, Some(axis)) => {
            let expected = format!("{} greater than 0", SIGMAS_AND_ROLE[axis]);
            let found = format!("the weighted point {} without it", point.label);
            let field = line.field(SIGMAS_AND_ROLE[axis]).or(line.field("role"));
            Err(field
                .unwrap_or(line.required("label")?)
                .unexpected(found, expected))
        }
        _ => Ok(()),
    }
}

/// The text of a control file.
#[must_use]
pub fn control_csv(points: &[ControlPoint]) -> String {
    csv_text(
        "label,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,role",
        points.iter().map(|point| {
            let role = match point.role {
                ControlRole::Align => "align",
                ControlRole::Weighted => "weighted",
                ControlRole::Fixed => "fixed",
                ControlRole::Check => "check",
            };
            let mut row = vec![point.label.clone()];
            row.extend(numbers(&point.coordinates_mm, &point.sigmas_mm));
            row.push(role.to_owned());
            row
        }),
    )
}

/// The text of a reference file.
#[must_use]
pub fn reference_csv(points: &[ReferencePoint]) -> String {
    csv_text(
        "label,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm",
        points.iter().map(|point| {
            let mut row = vec![point.label.clone().unwrap_or_default()];
            row.extend(numbers(&point.coordinates_mm, &point.sigmas_mm));
            row
        }),
    )
}

fn numbers(coordinates: &[Option<f64>; 3], sigmas: &[Option<f64>; 3]) -> Vec<String> {
    let text = |value: &Option<f64>| value.map(|v| v.to_string()).unwrap_or_default();
    coordinates.iter().chain(sigmas).map(text).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_is_read_as_it_is_written() {
        let point = |label: &str, role, sigmas_mm| ControlPoint {
            label: label.into(),
            coordinates_mm: [Some(1.0 / 3.0), Some(-2e-9), Some(1234.5)],
            sigmas_mm,
            role,
        };
        let mut points = vec![
            point("C1", ControlRole::Align, [None; 3]),
            point(
                "C2.A",
                ControlRole::Weighted,
                [Some(0.01), Some(0.02), Some(0.03)],
            ),
            point("R14-3", ControlRole::Fixed, [None, Some(0.1), None]),
            point("M5", ControlRole::Check, [None; 3]),
        ];
        points[0].coordinates_mm = [None, Some(2.0), None];
        assert_eq!(
            parse_control("c.csv", &control_csv(&points), &[]),
            Ok(points)
        );
    }

    #[test]
    fn a_reference_is_read_as_it_is_written() {
        let point = |label: Option<&str>, name: &str| ReferencePoint {
            label: label.map(str::to_owned),
            name: name.into(),
            coordinates_mm: [Some(0.1), Some(1e6 / 7.0), None],
            sigmas_mm: [None, Some(0.01), None],
        };
        let points = vec![
            point(Some("C1.O"), "C1.O"),
            point(Some("T12"), "T12"),
            point(None, "line 4"),
        ];
        assert_eq!(
            parse_reference("r.csv", &reference_csv(&points)),
            Ok(points)
        );
    }

    #[test]
    fn the_export_of_points_serves_as_a_reference() {
        let text = "label,kind,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,rays\nC1.O,code,1,2,3,0.1,0.1,0.1,5\n";
        let points = parse_reference("r.csv", text).unwrap();
        assert_eq!(points[0].coordinates_mm, [Some(1.0), Some(2.0), Some(3.0)]);
        assert!(
            parse_control("r.csv", text, &[]).is_err(),
            "control knows its columns"
        );
    }

    #[test]
    fn numbered_points_are_called_by_their_kind() {
        let text = "number,kind,x_mm,y_mm,z_mm,remark\n2,ring14,-0.2,-0.1,-0.3,\n501,dot,1,2,3,clean\n17,dot420,1,2,3,\n";
        let points = parse_reference("p.csv", text).unwrap();
        let labels: Vec<_> = points.iter().map(|p| p.label.as_deref()).collect();
        assert_eq!(labels, [Some("R14-2"), Some("dot 501"), Some("C17")]);
        let control = parse_control("p.csv", text, &[]).unwrap();
        assert_eq!(control.len(), 2, "a plain dot is no control point");
    }

    #[test]
    fn bad_control_is_answered_in_one_line() {
        for (text, line) in [
            (
                "label,x_mm,y_mm,z_mm\nT12,1,2,3",
                "c.csv, line 2, column 1 (label): found 'T12', expected the label of a point such as C17, C17.A, R14-57, M5 or a dot of the cross (no cross was given)",
            ),
            (
                "label,x_mm,y_mm,z_mm\nC1,1,2,3\nC1.O,1,2,3",
                "c.csv, line 3, column 1 (label): found the label C1.O again, expected it once",
            ),
            (
                "label,x_mm,y_mm,z_mm\nC1,,,",
                "c.csv, line 2, column 2 (x_mm): found no coordinate of C1, expected at least one",
            ),
            (
                "label,x_mm,y_mm,z_mm,role\nC1,1,2,3,free",
                "c.csv, line 2, column 5 (role): found 'free', expected align, weighted, fixed or check",
            ),
            (
                "label,x_mm,y_mm,z_mm,role\nC1,1,2,3,weighted",
                "c.csv, line 2, column 5 (role): found the weighted point C1 without it, expected sigma_x_mm greater than 0",
            ),
            (
                "label,x_mm,y_mm,z_mm,sigma_x_mm\nC1,1,2,3,0",
                "c.csv, line 2, column 5 (sigma_x_mm): found '0', expected a number greater than 0",
            ),
            (
                "label,x_mm,y_mm,z_mm,sigma_mm\nC1,1,2,3,1",
                "c.csv, line 1, column 5: found the column 'sigma_mm', expected label,x_mm,y_mm,z_mm[,sigma_x_mm][,sigma_y_mm][,sigma_z_mm][,role]",
            ),
            (
                "number,kind,x_mm,y_mm,z_mm\n517,ring14,1,2,3",
                "c.csv, line 2, column 1 (number): found '517', expected the number of a ring14 code from 1 to 516",
            ),
            (
                "number,kind,x_mm,y_mm,z_mm\n5,ring14,1,2,3\n5,ring14,1,2,4",
                "c.csv, line 3, column 1 (number): found the point R14-5 again, expected it once",
            ),
            (
                "number,kind,x_mm,y_mm,z_mm\n5,dot,1,2,3",
                "c.csv: found no point of a code family, expected a kind such as ring14 or dot420",
            ),
            (
                "number,kind,x_mm,y_mm\n5,ring14,1,2",
                "c.csv, line 1: found no column z_mm in the header 'number,kind,x_mm,y_mm', expected number,kind,x_mm,y_mm,z_mm[,sigma_x_mm][,sigma_y_mm][,sigma_z_mm]",
            ),
        ] {
            let error = parse_control("c.csv", text, &[]).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
    }

    #[test]
    fn a_bad_reference_is_answered_in_one_line() {
        for (text, line) in [
            (
                "label,x_mm,y_mm,z_mm\nT1,1,2,3\nT1,1,2,3",
                "r.csv, line 3, column 1 (label): found the label T1 again, expected it once",
            ),
            (
                "label,x_mm,y_mm,z_mm\nT1,1,two,3",
                "r.csv, line 2, column 3 (y_mm): found 'two', expected a number",
            ),
            (
                "label,x_mm,y_mm\nT1,1,2",
                "r.csv, line 1: found no column z_mm in the header 'label,x_mm,y_mm', expected label,x_mm,y_mm,z_mm[,sigma_x_mm][,sigma_y_mm][,sigma_z_mm][,role]",
            ),
        ] {
            let error = parse_reference("r.csv", text).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
    }
}
