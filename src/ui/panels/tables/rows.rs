//! The rows of each table, built from the network.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;

use super::TableKind;
use super::values::{Cell, Row, Table, TableColumn, column};
use crate::camera::INTERIOR_NAMES;
use crate::geometry::OmegaPhiKappa;
use crate::network::{
    AdjustedObservation, BarRole, ImageId, ImageUse, Network, Point, PointId, ScaleBar, Standing,
};
use crate::ui::action::Selection;
use crate::ui::format::digits_of_sigma;
use crate::ui::panels::facts::{
    ImageFacts, image_facts, select_image, select_observation, select_point,
};

const POINTS: &[TableColumn] = &[
    column("point", 80.0),
    column("kind", 60.0),
    column("x mm", 90.0),
    column("y mm", 90.0),
    column("z mm", 90.0),
    column("sigma x mm", 90.0),
    column("sigma y mm", 90.0),
    column("sigma z mm", 90.0),
    column("rays", 55.0),
];

const IMAGES: &[TableColumn] = &[
    column("image", 140.0),
    column("camera", 80.0),
    column("state", 80.0),
    column("targets", 70.0),
    column("labelled", 70.0),
    column("codes", 60.0),
    column("rms px", 70.0),
    column("X mm", 90.0),
    column("Y mm", 90.0),
    column("Z mm", 90.0),
    column("sigma X mm", 90.0),
    column("sigma Y mm", 90.0),
    column("sigma Z mm", 90.0),
    column("omega deg", 85.0),
    column("phi deg", 85.0),
    column("kappa deg", 85.0),
];

const OBSERVATIONS: &[TableColumn] = &[
    column("point", 80.0),
    column("image", 140.0),
    column("x px", 80.0),
    column("y px", 80.0),
    column("sigma px", 75.0),
    column("residual x px", 100.0),
    column("residual y px", 100.0),
    column("|w|", 60.0),
    column("redundancy", 85.0),
    column("standing", 75.0),
];

const BARS: &[TableColumn] = &[
    column("bar", 100.0),
    column("from", 80.0),
    column("to", 80.0),
    column("role", 70.0),
    column("known mm", 100.0),
    column("sigma mm", 80.0),
    column("adjusted - known mm", 150.0),
    column("w", 60.0),
];

const CAMERAS: &[TableColumn] = &[
    column("camera", 110.0),
    column("parameter", 85.0),
    column("unit", 60.0),
    column("value", 110.0),
    column("sigma", 100.0),
    column("value / sigma", 100.0),
    column("at the start", 110.0),
];

/// Units of the ten parameters of interior orientation.
pub(in crate::ui::panels) const INTERIOR_UNITS: [&str; 10] = [
    "mm", "mm", "mm", "mm^-2", "mm^-4", "mm^-6", "mm^-1", "mm^-1", "1", "1",
];

/// Parameters given in mm; the others are small and are written with an exponent.
pub(in crate::ui::panels) const LENGTHS: usize = 3;

impl Table {
    /// The table of a network.
    pub(super) fn of(kind: TableKind, network: &Network) -> Self {
        let (columns, rows, empty) = match kind {
            TableKind::Points => (POINTS, points(network), "No point has coordinates yet."),
            TableKind::Images => (IMAGES, images(network), "No images."),
            TableKind::Observations => (
                OBSERVATIONS,
                observations(network),
                "No observations before an adjustment.",
            ),
            TableKind::Bars => (BARS, bars(network), "No scale bars."),
            TableKind::Cameras => (CAMERAS, cameras(network), "No cameras."),
        };
        Self {
            columns,
            rows,
            empty,
        }
    }
}

fn with_sigmas(values: &Vector3<f64>, sigmas: Option<Vector3<f64>>) -> Vec<Cell> {
    let digits = |i: usize| sigmas.map_or(4, |s| digits_of_sigma(s[i]));
    let places = (0..3).map(|i| Cell::number(values[i], digits(i)));
    let sigmas = (0..3).map(|i| Cell::known(sigmas.map(|s| s[i]), digits(i)));
    places.chain(sigmas).collect()
}

fn root(variances: Vector3<f64>) -> Vector3<f64> {
    variances.map(|v| v.max(0.0).sqrt())
}

fn points(network: &Network) -> Vec<Row> {
    let row = |(id, point): (&PointId, &Arc<Point>)| {
        let mut cells = vec![
            Cell::text(network.label(*id)),
            Cell::text(id.kind().to_string()),
        ];
        let sigmas = point.covariance.map(|q| root(q.diagonal()));
        cells.extend(with_sigmas(&point.position, sigmas));
        cells.push(Cell::count(point.rays as usize));
        Row {
            selection: select_point(*id),
            muted: false,
            cells,
        }
    };
    network.points.iter().map(row).collect()
}

fn images(network: &Network) -> Vec<Row> {
    let row = |facts: ImageFacts| {
        let image = &network.images[&facts.id];
        let excluded = facts.usage == ImageUse::Excluded;
        let state = if excluded {
            "excluded"
        } else {
            facts.orientation.word()
        };
        let mut cells = vec![
            Cell::text(facts.name),
            Cell::text(network.camera_of(image).name.as_str()),
            Cell::text(state),
            Cell::count(facts.targets),
            Cell::count(facts.labelled),
            Cell::count(facts.codes),
            Cell::known(facts.rms_px, 3),
        ];
        if let Some(station) = &image.station {
            let sigmas = station
                .covariance
                .map(|q| root(q.diagonal().fixed_rows::<3>(3).into_owned()));
            cells.extend(with_sigmas(&station.pose.centre_in_world, sigmas));
            let angles = OmegaPhiKappa::from_rotation(&station.pose.camera_from_world);
            let angles = [angles.omega, angles.phi, angles.kappa];
            cells.extend(angles.map(|a| Cell::number(a.to_degrees(), 4)));
        }
        cells.resize(IMAGES.len(), Cell::Empty);
        Row {
            selection: select_image(facts.id),
            muted: excluded,
            cells,
        }
    };
    image_facts(network).into_iter().map(row).collect()
}

fn observations(network: &Network) -> Vec<Row> {
    let Some(adjustment) = &network.adjustment else {
        return Vec::new();
    };
    let mut points: BTreeMap<PointId, Arc<str>> = BTreeMap::new();
    let images: BTreeMap<ImageId, Arc<str>> = network
        .images
        .iter()
        .map(|(id, image)| (*id, image.file.path.as_str().into()))
        .collect();
    let gone: Arc<str> = "an image that is gone".into();
    let (used, rejected): (Arc<str>, Arc<str>) = ("used".into(), "rejected".into());
    let row = |o: &AdjustedObservation| {
        let label = points.entry(o.point);
        let label = label
            .or_insert_with(|| network.label(o.point).into())
            .clone();
        let image = network.images.get(&o.image);
        let dot = image
            .and_then(|i| i.detections.as_ref())
            .and_then(|d| d.dots.get(o.dot.slot()));
        let used_here = o.standing == Standing::Used;
        let cells = vec![
            Cell::Text(label),
            Cell::Text(images.get(&o.image).unwrap_or(&gone).clone()),
            Cell::known(dot.map(|d| d.centre_px.x), 3),
            Cell::known(dot.map(|d| d.centre_px.y), 3),
            Cell::known(dot.map(|d| d.sigma_px), 3),
            Cell::number(o.residual_px.x, 3),
            Cell::number(o.residual_px.y, 3),
            Cell::number(o.test, 2),
            Cell::number(o.redundancy, 2),
            Cell::Text(if used_here {
                used.clone()
            } else {
                rejected.clone()
            }),
        ];
        Row {
            selection: select_observation(o.image, o.dot, Some(o.point)),
            muted: !used_here,
            cells,
        }
    };
    adjustment.observations.iter().map(row).collect()
}

fn bars(network: &Network) -> Vec<Row> {
    let results = network.adjustment.as_ref().map(|a| &a.bars);
    let row = |bar: &ScaleBar| {
        let result = results.and_then(|r| r.iter().find(|r| r.name == bar.name));
        let role = match bar.role {
            BarRole::Control => "control",
            BarRole::Check => "check",
        };
        let digits = digits_of_sigma(bar.sigma_mm);
        let cells = vec![
            Cell::text(bar.name.as_str()),
            Cell::text(bar.from.as_str()),
            Cell::text(bar.to.as_str()),
            Cell::text(role),
            Cell::number(network.bar_length_mm(bar), digits),
            Cell::number(bar.sigma_mm, digits),
            Cell::known(result.map(|r| r.difference_mm), 4),
            Cell::known(result.and_then(|r| r.test), 2),
        ];
        Row {
            selection: network
                .point_of_label(&bar.from)
                .map_or_else(|_| Selection::default(), select_point),
            muted: false,
            cells,
        }
    };
    network.scale_bars.iter().map(row).collect()
}

fn cameras(network: &Network) -> Vec<Row> {
    let mut rows = Vec::new();
    for (id, entry) in network.cameras.iter() {
        let covariance = network
            .adjustment
            .iter()
            .flat_map(|a| &a.cameras)
            .find(|c| c.camera == *id)
            .map(|c| c.covariance);
        let name: Arc<str> = entry.name.as_str().into();
        let values = entry.camera.interior.to_vector();
        let start = entry.nominal.interior.to_vector();
        for (i, parameter) in INTERIOR_NAMES.into_iter().enumerate() {
            let sigma = covariance.map(|q| q[(i, i)].max(0.0).sqrt());
            // A parameter that was held fixed has a zero there, which is no precision.
            let sigma = sigma.filter(|s| *s > 0.0);
            let number = |value: f64| match i < LENGTHS {
                true => Cell::number(value, sigma.map_or(4, digits_of_sigma)),
                false => Cell::Small { value, sigma },
            };
            let cells = vec![
                Cell::Text(name.clone()),
                Cell::text(parameter),
                Cell::text(INTERIOR_UNITS[i]),
                number(values[i]),
                match (covariance, sigma) {
                    (None, _) => Cell::Empty,
                    (Some(_), None) => Cell::text("fixed"),
                    (Some(_), Some(sigma)) => number(sigma),
                },
                Cell::known(sigma.map(|s| values[i] / s), 1),
                number(start[i]),
            ];
            rows.push(Row {
                selection: Selection::default(),
                muted: covariance.is_some() && sigma.is_none(),
                cells,
            });
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::fixture::network;
    use crate::ui::panels::tables::values::{Sort, as_text};

    fn labels(table: &Table, order: &[u32]) -> Vec<String> {
        let row = |row: &u32| table.rows[*row as usize].cells[0].to_string();
        order.iter().map(row).collect()
    }

    #[test]
    fn every_row_has_a_cell_for_each_column() {
        let mut network = network();
        network.scale_bars = Arc::new(vec![ScaleBar {
            name: "bar".into(),
            from: "M1".into(),
            to: "C1".into(),
            length_mm: 900.0,
            sigma_mm: 0.01,
            role: BarRole::Check,
            expansion: None,
        }]);
        for kind in TableKind::ALL {
            let table = Table::of(kind, &network);
            assert!(!table.rows.is_empty(), "{kind:?}");
            let count = table.columns.len();
            assert!(
                table.rows.iter().all(|r| r.cells.len() == count),
                "{kind:?}"
            );
        }
    }

    #[test]
    fn rows_are_sorted_by_value_and_filtered_by_text() {
        let table = Table::of(TableKind::Points, &network());
        let by_x = Sort::clicked(None, 2);
        assert_eq!(
            labels(&table, &table.order(Some(by_x), "")),
            ["X1", "M1", "C2.O", "C1.O"]
        );
        let down = Sort::clicked(Some(by_x), 2);
        assert_eq!(
            labels(&table, &table.order(Some(down), "")),
            ["C1.O", "C2.O", "M1", "X1"]
        );
        assert_eq!(labels(&table, &table.order(None, "c2")), ["C2.O"]);
    }

    #[test]
    fn rows_without_a_value_stand_last_either_way() {
        let table = Table::of(TableKind::Images, &network());
        let up = Sort::clicked(None, 7);
        for sort in [up, Sort::clicked(Some(up), 7)] {
            assert_eq!(labels(&table, &table.order(Some(sort), ""))[0], "img_1.png");
        }
    }

    #[test]
    fn the_text_has_digits_by_sigma() {
        let table = Table::of(TableKind::Points, &network());
        let text = as_text(&table, &table.order(None, "c1"));
        let line = text.lines().nth(1).unwrap();
        assert_eq!(
            line,
            "C1.O\tcode\t100.000\t0.000\t-50.250\t0.010\t0.020\t0.030\t2"
        );
    }
}
