//! Orientations that the observations hardly determine: the adjustment gives them, and the operator must not take them for good.

use std::collections::BTreeSet;

use super::chance::{Dot, UNLIKELY, log_chance, log_chance_of_pair};
use crate::network::{
    About, Finding, FindingKind, ImageEntry, ImageId, Network, PointId, Stage, Standing, Station,
};

/// A station is weak where its standard deviation along the worst axis exceeds this share of its distance to the points: 3 mm at
/// one metre, where good networks of codes alone have 0.7 mm at worst (Hattori et al., 2002).
const WEAK_SHARE: f64 = 0.003;

/// A station with a precision that makes it doubtful.
struct Weak {
    image: ImageId,
    sigma: f64,
    codes: usize,
}

/// A finding for each weak station; one for all where most are, as then it is not the single image that is to blame.
pub(super) fn weak_stations(network: &Network, stage: Stage) -> Vec<Finding> {
    let mut weak = Vec::new();
    let mut all = 0;
    for (id, image, station) in network.oriented_images() {
        all += 1;
        weak.extend(weakness(network, id, image, station));
    }
    if 2 * weak.len() > all {
        let mut sigmas: Vec<f64> = weak.iter().map(|weak| weak.sigma).collect();
        sigmas.sort_by(f64::total_cmp);
        return vec![Finding {
            stage,
            kind: FindingKind::Connectivity,
            about: About::Project,
            text: format!(
                "{} of {all} stations are known to {:.0} mm and worse only, so the orientation is doubtful: more images, turned by 90 \
                 degrees and from other sides, would tell lens and stations apart",
                weak.len(),
                sigmas[0]
            ),
        }];
    }
    let told = weak.iter().map(|weak| {
        let count = match weak.codes {
            1 => "1 code".to_owned(),
            n => format!("{n} codes"),
        };
        Finding {
            stage,
            kind: FindingKind::Connectivity,
            about: About::Image(weak.image),
            text: format!(
                "{}: its station is known to {:.0} mm only, it hangs on {count}: its orientation is doubtful",
                network.images[&weak.image].file.path, weak.sigma
            ),
        }
    });
    told.collect()
}

fn weakness(network: &Network, id: ImageId, image: &ImageEntry, station: &Station) -> Option<Weak> {
    let covariance = station.covariance.as_ref()?;
    let centre = covariance.fixed_view::<3, 3>(3, 3).into_owned();
    let sigma = centre.symmetric_eigenvalues().max().max(0.0).sqrt();
    let mut distances = Vec::new();
    let mut codes = Vec::new();
    for (_, label) in image.used_labels() {
        if let Some(point) = network.points.get(&label.point) {
            distances.push((point.position - station.pose.centre_in_world).norm());
            codes.extend(label.point.code());
        }
    }
    distances.sort_by(f64::total_cmp);
    codes.sort_unstable();
    codes.dedup();
    let distance = *distances.get(distances.len() / 2)?;
    (sigma > WEAK_SHARE * distance).then_some(Weak {
        image: id,
        sigma,
        codes: codes.len(),
    })
}

/// A finding where two images are all that is oriented and their dots, as they are named, might meet by chance. A cross or a third image
/// would tell.
pub(super) fn chance_pair(network: &Network, stage: Stage) -> Option<Finding> {
    /// A dot agrees within so many standard deviations.
    const SIGMAS: f64 = 3.0;
    let oriented: Vec<ImageId> = network.oriented_images().map(|(id, ..)| id).collect();
    let &[first, second] = &oriented[..] else {
        return None;
    };
    let adjustment = network.adjustment.as_ref()?;
    let named = |id: ImageId| -> BTreeSet<PointId> {
        let labels = network.images[&id].labels.values();
        labels.map(|label| label.point).collect()
    };
    let common: Vec<PointId> = named(first).intersection(&named(second)).copied().collect();
    if common.iter().any(|id| matches!(id, PointId::Device(_))) {
        return None;
    }
    let used = adjustment.observations.iter();
    let used = used.filter(|row| row.standing == Standing::Used);
    let mut agreeing = BTreeSet::new();
    let mut largest = 0.0_f64;
    for row in used {
        agreeing.insert(row.point);
        let detections = network.images[&row.image].detections.as_ref()?;
        // A lens that gives way may leave less than noise.
        let noise = SIGMAS * detections.dots[row.dot.slot()].sigma_px;
        largest = largest.max(row.residual_px.norm()).max(noise);
    }
    // Both images give way to a dot that lies off its epipolar line.
    let camera = &network.camera_of(&network.images[&first]).camera;
    let chance = log_chance_of_pair(common.len(), agreeing.len(), camera, 2.0 * largest);
    (chance > UNLIKELY).then(|| Finding {
        stage,
        kind: FindingKind::Connectivity,
        about: About::Project,
        text: format!(
            "the {} of {} common dots in which the two oriented images agree might meet by chance, so the orientation is doubtful: a third \
             image would tell",
            agreeing.len(),
            common.len()
        ),
    })
}

/// A finding for each orientation that its dots, as they are named, might agree with by chance.
pub(super) fn chance_orientations(network: &Network, stage: Stage) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (id, image, station) in network.oriented_images() {
        let Some(detections) = &image.detections else {
            continue;
        };
        let camera = &network.camera_of(image).camera;
        let mut dots = Vec::new();
        let mut largest = 0.0_f64;
        for (dot, label) in image.labels.iter() {
            let Some(point) = network.points.get(&label.point) else {
                continue;
            };
            let pixel = detections.dots[dot.slot()].centre_px;
            let known = (label.point, &point.position);
            let dot = Dot::under(camera, &station.pose, known, pixel);
            if let (Some(miss), None) = (dot.miss, &label.rejected) {
                largest = largest.max(miss.norm());
            }
            dots.push(dot);
        }
        if log_chance(&dots, camera, largest) > UNLIKELY {
            findings.push(Finding {
                stage,
                kind: FindingKind::Connectivity,
                about: About::Image(id),
                text: format!(
                    "{}: what agrees of its {} named dots might do so by chance: its orientation is doubtful",
                    image.file.path,
                    dots.len()
                ),
            });
        }
    }
    findings
}
