//! `cross.csv`: the dots of the reference cross in its own frame.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::FileError;
use super::error::{Place, read_with};
use super::table::{Columns, OtherColumns, Table};
use crate::network::{DevicePoint, PointId};
use crate::report::csv_text;

const COLUMNS: Columns = Columns {
    required: &["label", "x_mm", "y_mm", "z_mm"],
    optional: &[],
    others: OtherColumns::Refused,
};

/// Fewest dots of a cross, as many as the 11 parameters of the direct linear transformation need.
const FEWEST_DOTS: usize = 6;
/// Dots whose second extent is smaller than this share of the first lie on one line.
const LEAST_WIDTH: f64 = 1e-6;

/// Reads the dots of a cross.
///
/// # Errors
/// [`FileError`], one line.
pub fn read_cross(path: &Path) -> Result<Vec<DevicePoint>, FileError> {
    read_with(path, parse_cross)
}

/// The dots of a cross in a text; `file` is its name in messages.
///
/// # Errors
/// [`FileError`], one line.
pub fn parse_cross(file: &str, text: &str) -> Result<Vec<DevicePoint>, FileError> {
    let table = Table::parse(file, text, COLUMNS)?;
    let mut dots: Vec<DevicePoint> = Vec::new();
    for line in table.lines() {
        let label = line.required("label")?;
        let dot = DevicePoint {
            label: label.name()?.to_owned(),
            position_mm: [
                line.required("x_mm")?.number()?,
                line.required("y_mm")?.number()?,
                line.required("z_mm")?.number()?,
            ],
        };
        if dots.iter().any(|other| other.label == dot.label) {
            return Err(label.unexpected(format!("the label {} again", dot.label), "it once"));
        }
        // In tables and exports such a label could not be told from the other point's.
        if dot
            .label
            .parse::<PointId>()
            .is_ok_and(|id| id.to_string() == dot.label)
        {
            return Err(label.expected("a label that is not one of a code or target, such as X1"));
        }
        if let Some(other) = dots.iter().find(|o| o.position_mm == dot.position_mm) {
            return Err(label.unexpected(
                format!("{} at the place of {}", dot.label, other.label),
                "every dot at a place of its own",
            ));
        }
        dots.push(dot);
    }
    if dots.len() < FEWEST_DOTS {
        let found = match dots.len() {
            1 => "a cross with 1 dot".to_owned(),
            n => format!("a cross with {n} dots"),
        };
        let expected = format!("{FEWEST_DOTS} or more");
        return Err(FileError::unexpected(file, Place::File, found, expected));
    }
    if on_one_line(&dots) {
        return Err(FileError::unexpected(
            file,
            Place::File,
            "a cross with all dots on one line",
            "dots in two directions at least",
        ));
    }
    Ok(dots)
}

fn on_one_line(dots: &[DevicePoint]) -> bool {
    let places: Vec<Vector3<f64>> = dots.iter().map(|d| Vector3::from(d.position_mm)).collect();
    let centre = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    let spread: Matrix3<f64> = places
        .iter()
        .map(|p| (p - centre) * (p - centre).transpose())
        .sum();
    let mut extents = spread.symmetric_eigenvalues().map(|e| e.max(0.0).sqrt());
    extents.as_mut_slice().sort_by(f64::total_cmp);
    extents[1] <= LEAST_WIDTH * extents[2]
}

/// The text of a cross file.
#[must_use]
pub fn cross_csv(dots: &[DevicePoint]) -> String {
    csv_text(
        "label,x_mm,y_mm,z_mm",
        dots.iter().map(|dot| {
            let [x, y, z] = dot.position_mm.map(|v| v.to_string());
            vec![dot.label.clone(), x, y, z]
        }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEFAULT: &str = "label,x_mm,y_mm,z_mm\nX1,0,0,40\nX2,100,0,0\nX3,-100,0,0\nX4,0,100,0\nX5,0,-100,0\nX6,50,50,25\n";

    #[test]
    fn a_cross_is_read_as_it_is_written() {
        let mut dots = parse_cross("x.csv", DEFAULT).unwrap();
        assert_eq!(dots[0].position_mm, [0.0, 0.0, 40.0]);
        dots[2].position_mm = [-99.987_654_321, 1e-7, 1.0 / 3.0];
        dots[3].label = "left, upper".into();
        assert_eq!(parse_cross("x.csv", &cross_csv(&dots)), Ok(dots));
    }

    #[test]
    fn marks_line_ends_blank_lines_and_order_are_no_faults() {
        let text = "\u{feff}\r\nz_mm, label ,x_mm,y_mm\r\n40,X1,0,0\r\n,,,\r\n0,X2,100,0\r\n\r\n0,X3,-100,0\r\n0,X4,0,100\r\n0,X5,0,-100\r\n25, \"X6\",50,50";
        assert_eq!(parse_cross("x.csv", text), parse_cross("x.csv", DEFAULT));
    }

    #[test]
    fn bad_files_are_answered_in_one_line() {
        let flat = |z: &str| format!("label,x_mm,y_mm,z_mm\nX1,1,2,{z}\n");
        let line_of_dots = "label,x_mm,y_mm,z_mm\n".to_owned()
            + &(0..6)
                .map(|i| format!("X{i},{i},{},0\n", 2 * i))
                .collect::<String>();
        for (text, line) in [
            (
                String::new(),
                "x.csv: found nothing, expected the header label,x_mm,y_mm,z_mm",
            ),
            (
                "\n ,, \n".into(),
                "x.csv: found nothing, expected the header label,x_mm,y_mm,z_mm",
            ),
            (
                "label,x_mm,y_mm,z_mm\n".into(),
                "x.csv: found nothing below the header, expected at least one line",
            ),
            (
                "X1,0,0,40\n".into(),
                "x.csv, line 1: found 'X1,0,0,40', expected the header label,x_mm,y_mm,z_mm",
            ),
            (
                "label,x_mm,y_mm\nX1,0,0".into(),
                "x.csv, line 1: found no column z_mm in the header 'label,x_mm,y_mm', expected label,x_mm,y_mm,z_mm",
            ),
            (
                "label,x_mm,y_mm,z_mm,r\n".into(),
                "x.csv, line 1, column 5: found the column 'r', expected label,x_mm,y_mm,z_mm",
            ),
            (
                "label,x_mm,y_mm,z_mm,x_mm\n".into(),
                "x.csv, line 1, column 5: found the column x_mm again, expected it once",
            ),
            (
                "label;x_mm;y_mm;z_mm\nX1;0,5;1;2".into(),
                "x.csv, line 1: found semicolons between the columns, expected commas (and decimal points): label,x_mm,y_mm,z_mm",
            ),
            (
                "label\tx_mm\ty_mm\tz_mm\n".into(),
                "x.csv, line 1: found tabs between the columns, expected commas (and decimal points): label,x_mm,y_mm,z_mm",
            ),
            (
                flat("3,5"),
                "x.csv, line 2: found 5 fields, expected 4 (label,x_mm,y_mm,z_mm), numbers with a decimal point",
            ),
            (
                flat("\"3,5\""),
                "x.csv, line 2, column 4 (z_mm): found '3,5', expected a number with a decimal point",
            ),
            (
                flat("\"3"),
                "x.csv, line 2: found a quotation mark that is not closed, expected the other one in the same line",
            ),
            (
                "label,x_mm,y_mm,z_mm\n\nX1,1\n".into(),
                "x.csv, line 3: found 2 fields, expected 4 (label,x_mm,y_mm,z_mm)",
            ),
            (
                flat("high"),
                "x.csv, line 2, column 4 (z_mm): found 'high', expected a number",
            ),
            (
                flat(""),
                "x.csv, line 2, column 4 (z_mm): found nothing, expected a number",
            ),
            (
                flat("nan"),
                "x.csv, line 2, column 4 (z_mm): found 'nan', expected a finite number",
            ),
            (
                flat("1e999"),
                "x.csv, line 2, column 4 (z_mm): found '1e999', expected a finite number",
            ),
            (
                "label,x_mm,y_mm,z_mm\n,0,0,0\n".into(),
                "x.csv, line 2, column 1 (label): found nothing, expected a name",
            ),
            (
                DEFAULT.replace("X2", "X1"),
                "x.csv, line 3, column 1 (label): found the label X1 again, expected it once",
            ),
            (
                DEFAULT.replace("X2", "M2"),
                "x.csv, line 3, column 1 (label): found 'M2', expected a label that is not one of a code or target, such as X1",
            ),
            (
                DEFAULT.replace("-100,0,0", "100,0,0"),
                "x.csv, line 4, column 1 (label): found X3 at the place of X2, expected every dot at a place of its own",
            ),
            (
                DEFAULT.replace("X6,50,50,25\n", ""),
                "x.csv: found a cross with 5 dots, expected 6 or more",
            ),
            (
                line_of_dots,
                "x.csv: found a cross with all dots on one line, expected dots in two directions at least",
            ),
        ] {
            let error = parse_cross("x.csv", &text).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
    }
}
