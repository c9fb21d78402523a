//! `adjust`: a network without pictures.

use std::path::{Path, PathBuf};

use super::terminal::show;
use super::{CommandError, Form};
use crate::adjustment::{AdjustmentError, OutlierTest, RejectionSettings};
use crate::monitor::Monitor;
use crate::plain_network::{
    DatumPoints, NamedText, PlainDatum, PlainError, PlainNetwork, PlainSettings, Weights, from_json,
};
use crate::report::{
    PlainAnswers, PlainReport, Question, asks, check_apart, covariance_csv, write_file,
};

/// Which network to adjust, and how.
#[derive(Clone, Debug)]
pub struct AdjustRequest {
    /// File of the network.
    pub network: PathBuf,
    /// Reject image points whose |w| exceeds this; `None`: all are used.
    pub reject: Option<f64>,
    /// What |w| is compared with.
    pub test: OutlierTest,
    /// Where the weights come from.
    pub weights: Weights,
    /// What the coordinates refer to, in place of what the file says: `all`, `control`, or names of points.
    pub datum: Option<String>,
    /// Pairs of points whose distance is asked for, `A,B`.
    pub distances: Vec<String>,
    /// Triples of points whose angle at the second is asked for, `A,B,C`.
    pub angles: Vec<String>,
    /// File for the whole covariance matrix (CSV).
    pub covariance: Option<PathBuf>,
}

/// Adjusts a network and prints the result.
///
/// # Errors
/// [`CommandError`] where the file is bad or the network cannot be adjusted.
pub fn adjust(request: &AdjustRequest, form: Form, monitor: &Monitor) -> Result<(), CommandError> {
    if let Some(covariance) = &request.covariance {
        let read = [("the network", request.network.as_path())];
        check_apart(&read, &[("--covariance", covariance)])?;
    }
    let text = read(&request.network)?;
    let name = request.network.to_string_lossy();
    let mut network = from_json(NamedText {
        file: &name,
        text: &text,
    })
    .map_err(|error| CommandError::input(error.to_string()))?;
    let rejection = match request.reject {
        Some(critical) if critical.is_finite() && critical > 0.0 => Some(RejectionSettings {
            test: request.test,
            critical,
            restore: RejectionSettings::default().restore.min(critical),
            ..RejectionSettings::default()
        }),
        Some(other) => {
            return Err(CommandError::input(format!(
                "--reject: found {other}, expected a number greater than 0"
            )));
        }
        None => None,
    };
    if let Some(datum) = &request.datum {
        network.datum = datum_of(&network, datum)?;
        network
            .check_datum()
            .map_err(|fault| CommandError::input(format!("--{fault}")))?;
    }
    let questions = questions(&network, request)?;
    let settings = PlainSettings {
        rejection,
        weights: request.weights,
        ..PlainSettings::default()
    };
    let adjusted = network
        .adjust(&settings, monitor)
        .map_err(|error| match error {
            PlainError::Interrupted => interrupted(&name),
            other => CommandError::work(format!("{name}: {other}")),
        })?;
    let mut report = PlainReport::new(&network, &adjusted);
    if asks(&network, &questions) || request.covariance.is_some() {
        let solved = adjusted.solved(monitor).map_err(|error| match error {
            AdjustmentError::Interrupted(_) => interrupted(&name),
            other => CommandError::work(format!("{name}: {other}")),
        })?;
        report.answers = PlainAnswers::new(&network, &adjusted, &solved, &questions)
            .map_err(|error| CommandError::input(error.to_string()))?;
        let not_compared = report.answers.not_compared.iter().cloned();
        report.findings.extend(not_compared);
        if let Some(file) = &request.covariance {
            let csv = covariance_csv(&network, &adjusted, &solved);
            write_file(file, csv.as_bytes())?;
        }
    }
    match form {
        Form::Json => {
            let json = serde_json::to_string_pretty(&report)
                .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
            show(&json)
        }
        Form::Text => show(&report.text()),
    }
}

fn interrupted(name: &str) -> CommandError {
    CommandError::interrupted(format!("{name}: interrupted; nothing was written"))
}

/// The datum in the operator's words.
fn datum_of(network: &PlainNetwork, words: &str) -> Result<PlainDatum, CommandError> {
    Ok(match words {
        "all" => PlainDatum::InnerConstraints(DatumPoints::All),
        "control" => PlainDatum::Control,
        names => {
            let points: Result<Vec<usize>, _> = names
                .split(',')
                .map(|name| point_of(network, "--datum", name))
                .collect();
            PlainDatum::InnerConstraints(DatumPoints::Listed(points?))
        }
    })
}

fn questions(
    network: &PlainNetwork,
    request: &AdjustRequest,
) -> Result<Vec<Question>, CommandError> {
    let mut questions = Vec::new();
    for words in &request.distances {
        questions.push(Question::Distance(points_of(network, "--distance", words)?));
    }
    for words in &request.angles {
        questions.push(Question::Angle(points_of(network, "--angle", words)?));
    }
    Ok(questions)
}

/// The points of so many names, separated by commas.
fn points_of<const COUNT: usize>(
    network: &PlainNetwork,
    option: &str,
    words: &str,
) -> Result<[usize; COUNT], CommandError> {
    let points: Result<Vec<usize>, _> = words
        .split(',')
        .map(|name| point_of(network, option, name))
        .collect();
    let points = points?;
    if let Some(again) = (1..points.len()).find(|&k| points[..k].contains(&points[k])) {
        let name = &network.points[points[again]].name;
        return Err(CommandError::input(format!(
            "{option}: found '{name}' again in '{words}', expected each point once"
        )));
    }
    points.try_into().map_err(|found: Vec<usize>| {
        CommandError::input(format!(
            "{option}: found {} names in '{words}', expected {COUNT} separated by commas",
            found.len()
        ))
    })
}

fn point_of(network: &PlainNetwork, option: &str, name: &str) -> Result<usize, CommandError> {
    let name = name.trim();
    let place = network.points.iter().position(|point| point.name == name);
    place.ok_or_else(|| {
        CommandError::input(format!(
            "{option}: found no point '{name}' in the network, expected the name of one"
        ))
    })
}

fn read(path: &Path) -> Result<String, CommandError> {
    let bytes = std::fs::read(path)
        .map_err(|error| CommandError::input(format!("{}: {error}", path.display())))?;
    String::from_utf8(bytes).map_err(|error| {
        CommandError::input(format!(
            "{}: found no text at byte {}, expected UTF-8",
            path.display(),
            error.utf8_error().valid_up_to()
        ))
    })
}
