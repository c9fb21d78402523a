//! What a run did, for programs and for people.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::Serialize;

use super::export::adjusted_points;
use super::missing::missing_by_class;
use crate::adjustment::Sigma0Test;
use crate::network::{
    About, AdjustmentResult, BarResult, ComponentResult, FindingKind, ImageUse, Network, Outcome,
    ScaleSource, Stage,
};

/// Level of the test of sigma0.
const TEST_LEVEL: f64 = 0.05;

/// A stage that ran.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StageRun {
    /// Which.
    pub stage: Stage,
    /// How long it took, s.
    pub seconds: f64,
    /// How it ended.
    pub outcome: Outcome,
}

/// What `run --json` tells; figures of the adjustment are `None` where there is none that belongs to the present inputs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunSummary {
    /// The stages that ran, in order.
    pub stages: Vec<StageRun>,
    /// Images in use.
    pub images: usize,
    /// Of these with an orientation.
    pub images_oriented: usize,
    /// Dots detected in images in use.
    pub targets: usize,
    /// Of these with a label.
    pub labelled: usize,
    /// Targets that oriented images ought to show and have no dot of, by class.
    #[serde(skip)]
    pub missing: BTreeMap<String, usize>,
    /// Adjusted points, or points with approximate coordinates where there is no adjustment.
    pub points: usize,
    /// Standard deviation of unit weight, without unit.
    pub sigma0: Option<f64>,
    /// sigma0 as a pixel measure.
    pub sigma0_px: Option<f64>,
    /// Rms residual per coordinate, px.
    pub rms_px: Option<f64>,
    /// Rms standard error of station coordinates, mm.
    pub sigma_station_mm: Option<f64>,
    /// Degrees of freedom.
    pub redundancy: Option<i64>,
    /// Where the scale comes from.
    pub scale_from: Option<ScaleSource>,
    /// What the stages noticed.
    pub findings: Vec<FindingReport>,
    /// Scale bars of the adjustment; in JSON where temperatures are known of one.
    #[serde(skip_serializing_if = "are_as_calibrated")]
    pub bars: Vec<BarReport>,
    #[serde(skip)]
    datum: Option<String>,
    #[serde(skip)]
    components: Vec<ComponentResult>,
}

/// A scale bar with the length that was used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BarReport {
    /// Its name.
    pub name: String,
    /// The length that it should have between its ends, mm.
    pub length_mm: f64,
    /// The calibrated length, mm.
    pub calibrated_mm: f64,
    /// Why the two differ; none where nothing is known of temperatures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Adjusted minus used length, mm.
    pub difference_mm: f64,
    /// Normalised residual; none for a check bar.
    pub test: Option<f64>,
}

/// Whether no bar is used with another length than the calibrated one.
fn are_as_calibrated(bars: &[BarReport]) -> bool {
    bars.iter().all(|bar| bar.reason.is_none())
}

/// A finding with names in place of ids.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FindingReport {
    /// Its class.
    pub kind: FindingKind,
    /// Path of an image, label of a point, name of a bar or camera, or `project`.
    pub about: String,
    /// One sentence.
    pub text: String,
}

impl RunSummary {
    /// The summary of a network after these stages ran.
    #[must_use]
    pub fn new(network: &Network, stages: &[StageRun]) -> Self {
        let adjustment: Option<&AdjustmentResult> = network
            .adjustment
            .as_deref()
            .filter(|_| network.adjustment_is_fresh());
        let mut targets = 0;
        let mut labelled = 0;
        for (_, image) in network.used_images() {
            if let Some(detections) = &image.detections {
                targets += detections.dots.len();
                labelled += image.labels.len();
            }
        }
        Self {
            stages: stages.to_vec(),
            images: network.used_images().count(),
            images_oriented: network.oriented_images().count(),
            targets,
            labelled,
            missing: missing_by_class(network)
                .into_iter()
                .map(|(kind, count)| (kind.to_string(), count))
                .collect(),
            points: match adjustment {
                Some(adjustment) => adjusted_points(network, adjustment).len(),
                None => network.points.len(),
            },
            sigma0: adjustment.map(|a| a.sigma0),
            sigma0_px: adjustment.map(|a| a.sigma0_px),
            rms_px: adjustment.map(|a| a.rms_px),
            sigma_station_mm: adjustment.map(|a| a.sigma_station_mm),
            redundancy: adjustment.map(|a| a.redundancy),
            scale_from: adjustment.map(|a| a.scale_from),
            findings: findings(network),
            bars: adjustment.map_or_else(Vec::new, |a| bars(network, a)),
            datum: adjustment.map(|a| a.datum.clone()),
            components: adjustment.map_or_else(Vec::new, |a| a.components.clone()),
        }
    }

    /// The summary for people.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        for run in &self.stages {
            let (stage, outcome) = (run.stage.to_string(), run.outcome);
            let _ = writeln!(text, "{stage:<13} {:>8.2} s  {outcome}", run.seconds);
        }
        let _ = writeln!(
            text,
            "images        {} oriented of {}",
            self.images_oriented, self.images
        );
        let _ = writeln!(
            text,
            "targets       {} labelled of {}",
            self.labelled, self.targets
        );
        if !self.missing.is_empty() {
            let classes = self.missing.iter();
            let counts: Vec<String> = classes
                .map(|(class, count)| format!("{count} {class}"))
                .collect();
            let _ = writeln!(text, "missing       {}", counts.join(", "));
        }
        let _ = writeln!(text, "points        {}", self.points);
        match (
            self.sigma0,
            self.sigma0_px,
            self.rms_px,
            self.sigma_station_mm,
        ) {
            (Some(sigma0), Some(sigma0_px), Some(rms_px), Some(sigma_station)) => {
                let _ = writeln!(
                    text,
                    "sigma0        {sigma0:.3} ({sigma0_px:.4} px), rms {rms_px:.4} px, redundancy {}",
                    self.redundancy.unwrap_or_default()
                );
                let redundancy = self.redundancy.and_then(|r| usize::try_from(r).ok());
                if let Some(test) = Sigma0Test::new(sigma0, redundancy.unwrap_or(0), TEST_LEVEL) {
                    let _ = writeln!(text, "              {}", test.in_words());
                }
                if !self.components.is_empty() {
                    let groups: Vec<String> = self.components.iter().map(in_words).collect();
                    let _ = writeln!(text, "residuals     {} a-priori sigmas", groups.join(", "));
                }
                let _ = writeln!(text, "sigma station {sigma_station:.4} mm (a posteriori)");
            }
            _ => text.push_str("sigma0        no adjustment of the present measurement\n"),
        }
        if let Some(scale) = self.scale_from {
            let _ = writeln!(text, "scale from    {scale}");
        }
        if let Some(datum) = &self.datum {
            let _ = writeln!(text, "datum         {datum}");
        }
        for bar in &self.bars {
            let test = bar
                .test
                .map_or_else(|| "check".to_owned(), |w| format!("|w| {w:.1}"));
            let _ = writeln!(
                text,
                "bar           {}: {:.4} mm, off by {:+.4} mm, {test}",
                bar.name, bar.length_mm, bar.difference_mm
            );
            if let Some(reason) = &bar.reason {
                let _ = writeln!(
                    text,
                    "              calibrated {:.4} mm: {reason}",
                    bar.calibrated_mm
                );
            }
        }
        for finding in &self.findings {
            // Many texts name what they are about: their sentence stands alone in a journal.
            let named = finding.text.starts_with(&finding.about);
            let about = if named {
                String::new()
            } else {
                format!("{}: ", finding.about)
            };
            let _ = writeln!(text, "! {about}{}", finding.text);
        }
        text
    }
}

/// A group as `code dots 1.02 +- 0.01`.
fn in_words(component: &ComponentResult) -> String {
    format!(
        "{} {:.2} +- {:.2}",
        component.group, component.factor, component.sigma
    )
}

fn bars(network: &Network, adjustment: &AdjustmentResult) -> Vec<BarReport> {
    let report = |result: &BarResult| {
        let bar = network.scale_bars.iter().find(|b| b.name == result.name)?;
        Some(BarReport {
            name: bar.name.clone(),
            length_mm: network.bar_length_mm(bar),
            calibrated_mm: bar.length_mm,
            reason: network.reason_of_bar_length(bar),
            difference_mm: result.difference_mm,
            test: result.test,
        })
    };
    adjustment.bars.iter().filter_map(report).collect()
}

/// What two stages noticed alike is told once; an excluded image is of no concern.
fn findings(network: &Network) -> Vec<FindingReport> {
    let mut reports: Vec<FindingReport> = Vec::new();
    for finding in network.findings.iter() {
        if let About::Image(id) = finding.about
            && network
                .images
                .get(&id)
                .is_some_and(|image| image.usage == ImageUse::Excluded)
        {
            continue;
        }
        let report = FindingReport {
            kind: finding.kind,
            about: about(network, &finding.about),
            text: finding.text.clone(),
        };
        if !reports.contains(&report) {
            reports.push(report);
        }
    }
    reports
}

fn about(network: &Network, about: &About) -> String {
    match about {
        About::Project => "project".to_owned(),
        About::Image(id) => network
            .images
            .get(id)
            .map_or_else(|| format!("image {}", id.0), |i| i.file.path.clone()),
        About::Point(id) => network.label(*id),
        About::Bar(name) | About::Camera(name) => name.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;
    use crate::network::{BarRole, Expansion, Finding, ImageId, ScaleBar};

    fn network() -> Network {
        let mut network = fixture::network();
        network.note(Finding {
            stage: Stage::Connect,
            kind: FindingKind::UnconnectedImage,
            about: About::Image(ImageId(2)),
            text: "too few codes".into(),
        });
        network
    }

    const RUNS: [StageRun; 1] = [StageRun {
        stage: Stage::FirstPair,
        seconds: 1.5,
        outcome: Outcome::Done,
    }];

    #[test]
    fn the_summary_has_the_keys_of_the_contract() {
        let json = serde_json::to_string(&RunSummary::new(&network(), &RUNS)).unwrap();
        assert_eq!(
            json,
            r#"{"stages":[{"stage":"first-pair","seconds":1.5,"outcome":"done"}],"images":2,"images_oriented":1,"targets":8,"labelled":5,"points":3,"sigma0":1.02,"sigma0_px":0.0204,"rms_px":0.018,"sigma_station_mm":0.21,"redundancy":42,"scale_from":"codes","findings":[{"kind":"unconnected-image","about":"img_2.png","text":"too few codes"}]}"#
        );
    }

    #[test]
    fn stale_figures_are_not_told() {
        let mut network = network();
        network.inputs += 1;
        let summary = RunSummary::new(&network, &[]);
        assert_eq!(summary.sigma0, None);
        let json = serde_json::to_string(&summary).unwrap();
        assert!(json.contains(r#""sigma0":null,"sigma0_px":null"#), "{json}");
        assert!(
            summary
                .text()
                .contains("no adjustment of the present measurement")
        );
    }

    #[test]
    fn a_warm_bar_is_told_with_its_length_and_the_reason() {
        let mut network = network();
        let bar = ScaleBar {
            name: "steel".into(),
            from: "C1".into(),
            to: "C2".into(),
            length_mm: 1000.0,
            sigma_mm: 0.01,
            role: BarRole::Control,
            expansion: Some(Expansion {
                per_k: 11.5e-6,
                temperature_c: 30.0,
                reference_c: 20.0,
            }),
        };
        network.scale_bars = vec![bar].into();
        let adjustment = network.adjustment.as_mut().map(std::sync::Arc::make_mut);
        adjustment.unwrap().bars = vec![BarResult {
            name: "steel".into(),
            difference_mm: 0.0023,
            test: Some(0.7),
        }];
        let text = RunSummary::new(&network, &RUNS).text();
        let lines = "bar           steel: 1000.1150 mm, off by +0.0023 mm, |w| 0.7
              calibrated 1000.0000 mm: bar at 30 C, 11.5e-6/K from 20 C\n";
        assert!(text.contains(lines), "{text}");
        let json = serde_json::to_string(&RunSummary::new(&network, &RUNS)).unwrap();
        assert!(
            json.contains(r#""bars":[{"name":"steel","length_mm":1000.1"#),
            "{json}"
        );
        let bars = std::sync::Arc::make_mut(&mut network.scale_bars);
        bars[0].expansion = None;
        let json = serde_json::to_string(&RunSummary::new(&network, &RUNS)).unwrap();
        assert!(!json.contains("bars"), "{json}");
    }

    #[test]
    fn people_read_the_same() {
        let text = RunSummary::new(&network(), &RUNS).text();
        assert!(
            text.starts_with("first-pair        1.50 s  done\n"),
            "{text}"
        );
        assert!(text.contains("images        1 oriented of 2\n"), "{text}");
        assert!(text.contains("! img_2.png: too few codes\n"), "{text}");
    }
}
