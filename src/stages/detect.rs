//! Detection: targets and codes of every image, a batch of images a step.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::{Advance, Halt, Pictures, Step};
use crate::monitor::Monitor;
use crate::network::{
    About, CODES_TO_CONNECT, CameraEntry, Connectivity, Finding, FindingKind, ImageConnectivity,
    ImageEntry, ImageId, InteriorSource, Label, MeasurementSettings, Network, PointId, Source,
    Stage,
};
use crate::targets::{
    CodeReading, DetectSettings, Detections, Dot420Settings, DotIndex, Family, NominalCamera,
    detect_unless_interrupted,
};

/// The images of the next step: the first ones without detections, a batch of them.
pub(super) fn next(network: &Network) -> Option<Step> {
    let batch: Vec<ImageId> = network
        .used_images()
        .filter(|(_, image)| image.detections.is_none() && image.unreadable.is_none())
        .map(|(id, _)| id)
        .take(network.settings.detection_batch.max(1))
        .collect();
    (!batch.is_empty()).then_some(Step::Detect(batch))
}

/// Detects targets in a batch of images; an interrupt keeps the images that were finished.
///
/// Cost: pixels of the batch; memory: one picture a thread.
pub(super) fn run(
    mut network: Network,
    images: &[ImageId],
    pictures: &dyn Pictures,
    monitor: &Monitor,
) -> Result<Advance, Halt> {
    let task = monitor.task("detecting targets", images.len() as u64);
    let found: Vec<Option<Result<Detections, String>>> = images
        .par_iter()
        .map(|id| {
            task.step().ok()?;
            let families = &network.settings.families;
            let image = &network.images[id];
            let settings = detect_settings(&network.settings, network.camera_of(image));
            match pictures.load(image, monitor) {
                Err(_) if monitor.is_interrupted() => None,
                Err(reason) => Some(Err(reason)),
                Ok(picture) => detect_unless_interrupted(&picture, families, &settings, monitor)
                    .ok()
                    .map(Ok),
            }
        })
        .collect();
    let complete = found.iter().all(Option::is_some);
    if !complete && found.iter().all(Option::is_none) {
        return Err(Halt::Interrupted);
    }
    for (&id, found) in images.iter().zip(found) {
        let Some(found) = found else { continue };
        let image = network.image_mut(id);
        match found {
            Ok(detections) => adopt(image, detections),
            Err(reason) => image.unreadable = Some(reason),
        }
        // One a picture, not one a batch: an interrupted batch must count as much as a whole one.
        network.inputs += 1;
    }
    Ok(Advance { network, complete })
}

/// The settings of detection that the measurement's settings and what is known of the camera ask for.
fn detect_settings(settings: &MeasurementSettings, camera: &CameraEntry) -> DetectSettings {
    /// How far principal distances may be wrong, as a share: files are copied from one camera to another, and a focal length is
    /// engraved for infinity.
    const SHARE_OF_FILE: f64 = 0.1;
    const SHARE_OF_EXIF: f64 = 0.15;
    let share = match camera.source {
        InteriorSource::CameraFile => Some(SHARE_OF_FILE),
        InteriorSource::Exif => Some(SHARE_OF_EXIF),
        InteriorSource::Unknown => None,
    };
    let sizes = settings.targets.of(Family::Dot420);
    DetectSettings {
        dot420: Dot420Settings {
            pitch_mm: sizes.pitch_mm,
            dot_mm: sizes.dot_mm,
            camera: share.map(|share| NominalCamera::of(&camera.nominal, share)),
            ..Dot420Settings::default()
        },
        ..DetectSettings::default()
    }
}

/// Why a reading names no dots: two targets of one number, or a wrong reading beside the right one.
const READ_TWICE: &str = "its number is read twice in this picture";

/// Puts detections into an image and names the dots of its codes.
///
/// Where two readings claim one dot, the one with the smaller misfit gets the labels. Where two claim one number, none
/// does: either may be wrong, and dots of a code that other images tell are named by identification.
pub fn adopt(image: &mut ImageEntry, detections: Detections) {
    let mut labels: BTreeMap<DotIndex, Label> = BTreeMap::new();
    let mut set_aside = BTreeMap::new();
    let mut order: Vec<usize> = (0..detections.codes.len()).collect();
    order.sort_by(|&a, &b| {
        let [a, b] = [a, b].map(|place| &detections.codes[place]);
        a.doubt
            .is_some()
            .cmp(&b.doubt.is_some())
            .then(a.misfit.total_cmp(&b.misfit))
    });
    for place in order {
        let reading = &detections.codes[place];
        let points = PointId::of_code(reading.family, reading.id);
        let number = |r: &CodeReading| (r.family, r.id);
        let readings = detections
            .codes
            .iter()
            .filter(|other| number(other) == number(reading));
        if readings.count() > 1 {
            set_aside.insert(place, READ_TWICE.to_owned());
            continue;
        }
        if reading.dots.iter().any(|dot| labels.contains_key(dot)) {
            continue;
        }
        for (&dot, &point) in reading.dots.iter().zip(&points) {
            labels.insert(
                dot,
                Label {
                    point,
                    source: Source::Automatic,
                    rejected: None,
                },
            );
        }
    }
    image.set_aside = Arc::new(set_aside);
    image.labels = Arc::new(labels);
    image.detections = Some(Arc::new(detections));
}

/// What the operator should know after detection: unreadable and empty images, images with too few codes.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut note = |kind, id, text| {
        findings.push(Finding {
            stage: Stage::Detect,
            kind,
            about: About::Image(id),
            text,
        });
    };
    for (id, image) in network.used_images() {
        if let Some(reason) = &image.unreadable {
            note(FindingKind::UnreadableImage, id, reason.clone());
        }
        for text in doubts(network, image) {
            note(FindingKind::DoubtfulCode, id, text);
        }
    }
    let connectivity = Connectivity::of(network);
    for row in connectivity.images.iter().filter(|row| row.missing > 0) {
        let image = &network.images[&row.image];
        // An image of plain targets alone, named by another program, is connected without a code.
        let needs_none = row.codes.is_empty() && image.station.is_some();
        if image.detections.is_some() && !needs_none {
            let text = missing_codes(network, &connectivity, row);
            note(FindingKind::Connectivity, row.image, text);
        }
    }
    findings.extend(separate_groups(&connectivity));
    findings
}

/// The readings of an image that detection doubts and the network does not bear out, a line for each doubt: many codes may share
/// one, and the list must stay one that is read.
fn doubts(network: &Network, image: &ImageEntry) -> Vec<String> {
    let mut codes_of: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    let readings = image.detections.iter().flat_map(|d| &d.codes);
    for (place, reading) in readings.enumerate() {
        if let Some(doubt) = reading.doubt.as_deref()
            && !network.bears_out(image, place)
        {
            let label = reading.family.code_label(reading.id);
            codes_of.entry(doubt).or_default().push(label);
        }
    }
    let lines = codes_of.iter();
    lines
        .map(|(doubt, codes)| format!("{}: {}: {doubt}", image.file.path, codes.join(", ")))
        .collect()
}

/// Brings what is told of doubtful readings up to date with what the network bears out by now.
pub(super) fn settle_doubts(network: &mut Network) {
    let mut open = Vec::new();
    for (id, image) in network.used_images() {
        open.extend(doubts(network, image).into_iter().map(|text| Finding {
            stage: Stage::Detect,
            kind: FindingKind::DoubtfulCode,
            about: About::Image(id),
            text,
        }));
    }
    if network.findings.iter().filter(|f| is_of_doubt(f)).eq(&open) {
        return;
    }
    let findings = Arc::make_mut(&mut network.findings);
    let place = findings.iter().position(is_of_doubt).unwrap_or(0);
    findings.retain(|finding| !is_of_doubt(finding));
    findings.splice(place..place, open);
}

fn is_of_doubt(finding: &Finding) -> bool {
    (finding.stage, finding.kind) == (Stage::Detect, FindingKind::DoubtfulCode)
}

fn missing_codes(
    network: &Network,
    connectivity: &Connectivity,
    row: &ImageConnectivity,
) -> String {
    let elsewhere = row
        .codes
        .iter()
        .filter(|code| connectivity.images_of_code[code].len() > 1)
        .count();
    let count = match row.codes.len() {
        1 => "1 code".to_owned(),
        n => format!("{n} codes"),
    };
    let seen = match elsewhere {
        n if n == row.codes.len() => String::new(),
        0 => ", none of them in another image".to_owned(),
        n => format!(", {n} of them in other images"),
    };
    format!(
        "{}: {count}{seen}, needs {} more to connect",
        network.images[&row.image].file.path, row.missing
    )
}

/// Groups of images without a link between them; an image that lacks codes itself is told of apart.
fn separate_groups(connectivity: &Connectivity) -> Option<Finding> {
    let sizes: Vec<String> = connectivity
        .blocks
        .iter()
        .filter(|block| block.len() > 1)
        .map(|block| block.len().to_string())
        .collect();
    (sizes.len() > 1).then(|| Finding {
        stage: Stage::Detect,
        kind: FindingKind::Connectivity,
        about: About::Project,
        text: format!(
            "the images fall into {} groups of {} images that share fewer than {CODES_TO_CONNECT} codes: an image that shows codes of both is missing",
            sizes.len(),
            sizes.join(" and ")
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::super::trial::{images_that_show, reading, texts};
    use super::*;

    #[test]
    fn what_is_missing_is_said_in_words() {
        let network = images_that_show(&[&[1, 2, 3, 4], &[1, 2, 3], &[3, 4], &[4, 9], &[20]]);
        assert_eq!(
            texts(&findings(&network)),
            [
                "image3.png: 2 codes, needs 1 more to connect",
                "image4.png: 2 codes, 1 of them in other images, needs 2 more to connect",
                "image5.png: 1 code, none of them in another image, needs 3 more to connect",
            ]
        );
    }

    #[test]
    fn groups_without_a_link_are_told() {
        let network = images_that_show(&[&[1, 2, 3], &[1, 2, 3], &[7, 8, 9], &[7, 8, 9]]);
        let found = findings(&network);
        assert_eq!(found.len(), 1);
        assert!(
            found[0]
                .text
                .starts_with("the images fall into 2 groups of 2 and 2 images")
        );
    }

    #[test]
    fn codes_of_one_doubt_make_one_line() {
        let mut network = images_that_show(&[&[1, 2, 3], &[1, 2, 3]]);
        let image = network.image_mut(ImageId(1));
        let detections = Arc::make_mut(image.detections.as_mut().unwrap());
        for (reading, doubt) in detections.codes.iter_mut().zip(["a", "b", "a"]) {
            reading.doubt = Some(doubt.to_owned());
        }
        let told = findings(&network);
        assert_eq!(texts(&told), ["image1.png: C1, C3: a", "image1.png: C2: b"]);
        settle_doubts(&mut network);
        assert_eq!(*network.findings, told);
        let detections = Arc::make_mut(network.image_mut(ImageId(1)).detections.as_mut().unwrap());
        detections.codes[0].doubt = None;
        settle_doubts(&mut network);
        assert_eq!(
            texts(&network.findings),
            ["image1.png: C3: a", "image1.png: C2: b"]
        );
    }

    #[test]
    fn a_number_read_twice_names_no_dot_of_that_picture() {
        let mut image = images_that_show(&[&[]]).images[&ImageId(1)]
            .as_ref()
            .clone();
        let detections = Detections {
            codes: vec![reading(5, 0), reading(5, 6), reading(8, 12)],
            ..Detections::default()
        };
        adopt(&mut image, detections);
        let named: Vec<PointId> = image.labels.values().map(|label| label.point).collect();
        assert_eq!(named, PointId::of_code(Family::Dot420, 8));
        assert_eq!(image.set_aside.keys().collect::<Vec<_>>(), [&0, &1]);
    }
}
