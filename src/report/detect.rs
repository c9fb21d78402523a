//! Targets and codes of a single picture.

use serde::Serialize;

use crate::network::{CodeDot, PointId};
use crate::targets::{CodeEvidence, Detections, Dot, Family};

/// What `detect --json` tells of one picture.
#[derive(Clone, Debug, Serialize)]
pub struct DetectReport {
    image: String,
    width_px: u32,
    height_px: u32,
    codes: Vec<CodeReport>,
    targets: Vec<TargetReport>,
    rejected: Vec<RejectedReport>,
}

#[derive(Clone, Debug, Serialize)]
struct CodeReport {
    family: Family,
    id: u32,
    label: String,
    dots: Vec<CodeDotReport>,
    doubt: Option<String>,
    #[serde(flatten)]
    evidence: CodeEvidence,
}

#[derive(Clone, Debug, Serialize)]
struct CodeDotReport {
    name: &'static str,
    x_px: f64,
    y_px: f64,
    sigma_px: f64,
}

#[derive(Clone, Debug, Serialize)]
struct TargetReport {
    x_px: f64,
    y_px: f64,
    sigma_px: f64,
    major_px: f64,
    minor_px: f64,
    angle_deg: f64,
    label: Option<String>,
}

#[derive(Clone, Debug, Serialize)]
struct RejectedReport {
    x_px: f64,
    y_px: f64,
    reason: String,
}

impl DetectReport {
    /// The report on a picture with this name.
    #[must_use]
    pub fn new(image: &str, detections: &Detections) -> Self {
        let mut targets: Vec<TargetReport> = detections.dots.iter().map(target).collect();
        let mut codes = Vec::new();
        for reading in &detections.codes {
            let mut dots = Vec::new();
            let points = PointId::of_code(reading.family, reading.id);
            for ((index, point), name) in reading.dots.iter().zip(points).zip(CodeDot::ALL) {
                let (Some(dot), Some(target)) = (
                    detections.dots.get(index.slot()),
                    targets.get_mut(index.slot()),
                ) else {
                    continue;
                };
                target.label = Some(point.to_string());
                dots.push(CodeDotReport {
                    name: name.name(),
                    x_px: dot.centre_px.x,
                    y_px: dot.centre_px.y,
                    sigma_px: dot.sigma_px,
                });
            }
            codes.push(CodeReport {
                family: reading.family,
                id: reading.id,
                label: reading.family.code_label(reading.id),
                dots,
                doubt: reading.doubt.clone(),
                evidence: reading.evidence,
            });
        }
        let rejected = detections.rejected.iter().map(|r| RejectedReport {
            x_px: r.place_px.x,
            y_px: r.place_px.y,
            reason: r.reason.clone(),
        });
        Self {
            image: image.to_owned(),
            width_px: detections.width_px,
            height_px: detections.height_px,
            codes,
            targets,
            rejected: rejected.collect(),
        }
    }
}

fn target(dot: &Dot) -> TargetReport {
    TargetReport {
        x_px: dot.centre_px.x,
        y_px: dot.centre_px.y,
        sigma_px: dot.sigma_px,
        major_px: dot.major_px,
        minor_px: dot.minor_px,
        angle_deg: dot.angle.to_degrees(),
        label: None,
    }
}

/// One line on a picture: `img_001.png: 3008 x 1960 px, 212 targets, 24 codes (C1 C2 ..), 7 refused`.
#[must_use]
pub fn detect_line(image: &str, detections: &Detections) -> String {
    let labels: Vec<String> = detections
        .codes
        .iter()
        .map(|code| code.family.code_label(code.id))
        .collect();
    let names = match labels.len() {
        0 => String::new(),
        _ => format!(" ({})", labels.join(" ")),
    };
    format!(
        "{image}: {} x {} px, {} targets, {} codes{names}, {} refused",
        detections.width_px,
        detections.height_px,
        detections.dots.len(),
        labels.len(),
        detections.rejected.len()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::{CodeEvidence, CodeReading, DotIndex, Rejected};
    use nalgebra::Vector2;

    #[test]
    fn the_report_has_the_keys_of_the_contract() {
        let dot = |x: f64| Dot {
            centre_px: Vector2::new(x, 2.5),
            sigma_px: 0.02,
            major_px: 8.0,
            minor_px: 6.0,
            angle: std::f64::consts::FRAC_PI_2,
            contrast: 100.0,
            background: 20.0,
        };
        let reading = |family, id, dots: &[u32]| CodeReading {
            family,
            id,
            dots: dots.iter().map(|&d| DotIndex(d)).collect(),
            misfit: 0.1,
            doubt: None,
            evidence: CodeEvidence::default(),
        };
        let detections = Detections {
            width_px: 20,
            height_px: 10,
            dots: (0..8).map(|i| dot(f64::from(i))).collect(),
            codes: vec![
                reading(Family::Dot420, 17, &[6, 5, 4, 3, 2, 1]),
                reading(Family::Ring(14), 57, &[0]),
            ],
            rejected: vec![Rejected {
                place_px: Vector2::new(1.0, 2.0),
                reason: "too small".into(),
            }],
            by_hand: Vec::new(),
            expected: Vec::new(),
        };
        let json = serde_json::to_string(&[DetectReport::new("a b.png", &detections)]).unwrap();
        assert!(json.starts_with(
            r#"[{"image":"a b.png","width_px":20,"height_px":10,"codes":[{"family":"dot420","id":17,"label":"C17","dots":[{"name":"O","x_px":6.0,"y_px":2.5,"sigma_px":0.02},{"name":"A","x_px":5.0,"#
        ), "{json}");
        assert!(json.contains(
            r#"{"family":"ring14","id":57,"label":"R14-57","dots":[{"name":"O","x_px":0.0,"y_px":2.5,"sigma_px":0.02}],"doubt":null,"fit":0.0,"margin":null,"rivals":0,"rival_odds":0.0,"foreign_dots":0,"departing_segments":0}"#
        ), "{json}");
        assert!(json.contains(
            r#""targets":[{"x_px":0.0,"y_px":2.5,"sigma_px":0.02,"major_px":8.0,"minor_px":6.0,"angle_deg":90.0,"label":"R14-57"},{"x_px":1.0,"#
        ), "{json}");
        assert!(
            json.contains(r#""label":"C17.3"},{"#)
                && json.contains(
                    r#""label":null}],"rejected":[{"x_px":1.0,"y_px":2.0,"reason":"too small"}]}]"#
                ),
            "{json}"
        );
        assert_eq!(
            detect_line("a b.png", &detections),
            "a b.png: 20 x 10 px, 8 targets, 2 codes (C17 R14-57), 1 refused"
        );
    }
}
