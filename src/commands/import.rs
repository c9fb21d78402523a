//! `import`: a project from the files of another program.

use super::CommandError;
use super::terminal::show;
use crate::monitor::Monitor;
use crate::network::{FindingKind, Network};
use crate::project::import::import as make;

pub use crate::project::import::{ImportPlan as ImportRequest, Program};

/// Makes a project of another program's network; nothing is written where any of its files is bad.
///
/// # Errors
/// [`CommandError`] for a missing folder, a missing or bad file, an existing project.
pub fn import(request: &ImportRequest, monitor: &Monitor) -> Result<(), CommandError> {
    let session = make(request, monitor)?;
    let mut text = format!(
        "{}: {}",
        request.project.display(),
        contents(session.network())
    );
    let findings = session.network().findings.iter();
    for finding in findings.filter(|finding| finding.kind == FindingKind::Import) {
        text.push_str(&format!("\n! {}", finding.text));
    }
    show(&text)
}

/// What a project holds, in words.
fn contents(network: &Network) -> String {
    let image_points: usize = network
        .images
        .values()
        .map(|image| image.labels.len())
        .sum();
    let pictures = network.images.values();
    let pictures = pictures.filter(|image| !image.file.sha256.is_empty());
    format!(
        "{} images ({} oriented, {} with a picture), {} points, {image_points} image points, {} scale bars, {} control points",
        network.images.len(),
        network.oriented_images().count(),
        pictures.count(),
        network.points.len(),
        network.scale_bars.len(),
        network.control.len()
    )
}
