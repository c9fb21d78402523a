//! The adjustments: codes alone, everything, and the one between two passes of identification.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::bundle::{Bundle, DatumPoints, restore_rejected};
use super::code_shape::CodeShapes;
use super::identify::set_code_aside;
use super::lens::LensFreedom;
use super::scale::{align_to_control, apply_scale, bars_in_reach};
use super::{Halt, StageError};
use crate::adjustment::{
    AdjustmentError, BundleSettings, RejectionSettings, RobustAdjustment, adjust_with_rejection,
};
use crate::monitor::Monitor;
use crate::network::{About, Finding, FindingKind, ImageId, Network, PointId, Stage, Standing};
use crate::targets::Family;

/// Fewest images on which a lens is calibrated; fewer cannot tell its parameters from their orientations.
const IMAGES_TO_CALIBRATE: usize = 6;

/// Share of a code's dots that must be rejected for its reading to be set aside.
const SHARE_TO_SET_ASIDE: f64 = 0.5;

/// Whether this adjustment has not been made on the present inputs.
pub(super) fn is_outdated(network: &Network, stage: Stage) -> bool {
    match (&network.adjustment, stage) {
        (Some(adjustment), Stage::AdjustCodes) => adjustment.basis != network.inputs,
        (Some(adjustment), _) => adjustment.basis != network.inputs || adjustment.stage != stage,
        (None, _) => true,
    }
}

/// The adjustment of a stage.
pub(super) fn run(network: &mut Network, stage: Stage, monitor: &Monitor) -> Result<(), Halt> {
    set_contradicted_codes_aside(network, stage);
    adjust(network, stage, monitor)
}

/// Adjusts all labelled dots, rejects gross errors, and records the result as that of `stage`.
pub(super) fn adjust(network: &mut Network, stage: Stage, monitor: &Monitor) -> Result<(), Halt> {
    restore_rejected(network);
    apply_scale(network);
    if stage == Stage::Adjust {
        align_to_control(network);
    }
    let datum = match stage {
        Stage::AdjustCodes => DatumPoints::Codes,
        Stage::Adjust => DatumPoints::Targets,
        _ => DatumPoints::All,
    };
    let images = network.oriented_images().count();
    let held = LensFreedom::Provisional { images };
    let freedom = if images >= IMAGES_TO_CALIBRATE {
        LensFreedom::Free
    } else {
        held
    };
    let mut bundle = Bundle::assemble(network, freedom, datum);
    let robust = match solve(&bundle, network, monitor) {
        Err(AdjustmentError::RankDefect { .. }) if freedom == LensFreedom::Free => {
            bundle = Bundle::assemble(network, held, datum);
            network.note(Finding {
                stage,
                kind: FindingKind::Camera,
                about: About::Project,
                text: "the images cannot tell all lens parameters: those they leave loose are held near nominal values"
                    .into(),
            });
            solve(&bundle, network, monitor)
        }
        other => other,
    }
    .map_err(halt)?;
    bundle.write_back(network, &robust.adjustment);
    bundle.mark_rejected(network, &robust.adjustment);
    if stage == Stage::Adjust {
        align_to_control(network);
    }
    network.adjustment = Some(Arc::new(bundle.result(network, stage, &robust.adjustment)));
    Ok(())
}

fn solve(
    bundle: &Bundle,
    network: &Network,
    monitor: &Monitor,
) -> Result<RobustAdjustment, AdjustmentError> {
    let settings = RejectionSettings {
        critical: network.settings.critical_w,
        ..RejectionSettings::default()
    };
    adjust_with_rejection(
        &bundle.problem,
        BundleSettings::default(),
        &settings,
        monitor,
    )
}

pub(super) fn halt(error: AdjustmentError) -> Halt {
    match error {
        AdjustmentError::Interrupted(_) => Halt::Interrupted,
        other => Halt::Failed(StageError::Adjustment {
            reason: other.to_string(),
        }),
    }
}

/// Codes whose coordinates contradict the shape of a code are clusters of plain targets read as codes.
fn set_contradicted_codes_aside(network: &mut Network, stage: Stage) {
    let contradicted = CodeShapes::of(network).contradicted(network);
    let ids: Vec<ImageId> = network.images.keys().copied().collect();
    for code in contradicted {
        for id in &ids {
            let shows = network.images[id]
                .labels
                .values()
                .any(|l| matches!(l.point, PointId::Code { family: Family::Dot420, code: c, .. } if c == code));
            if shows {
                let reason = "its dots do not have the shape of the code in space";
                set_code_aside(network.image_mut(*id), Family::Dot420, code, reason);
            }
        }
        Arc::make_mut(&mut network.points)
            .retain(|id, _| !matches!(id, PointId::Code { family: Family::Dot420, code: c, .. } if *c == code));
        network.note(Finding {
            stage,
            kind: FindingKind::DoubtfulCode,
            about: About::Project,
            text: format!("C{code}: its dots do not have the shape of the code in space; set aside in all images"),
        });
    }
}

/// Code readings of one image most of whose dots the adjustment rejected, with the largest |w|.
pub(super) fn misfitting_codes(network: &Network) -> Vec<(ImageId, Family, u32, f64)> {
    let Some(adjustment) = &network.adjustment else {
        return Vec::new();
    };
    #[derive(Default)]
    struct Tally {
        rejected: usize,
        all: usize,
        largest: f64,
    }
    let mut tallies: BTreeMap<(ImageId, Family, u32), Tally> = BTreeMap::new();
    for row in &adjustment.observations {
        let PointId::Code { family, code, .. } = row.point else {
            continue;
        };
        let tally = tallies.entry((row.image, family, code)).or_default();
        tally.all += 1;
        if row.standing == Standing::Rejected {
            tally.rejected += 1;
            tally.largest = tally.largest.max(row.test);
        }
    }
    tallies
        .into_iter()
        .filter(|(_, tally)| tally.rejected as f64 > SHARE_TO_SET_ASIDE * tally.all as f64)
        .map(|((image, family, code), tally)| (image, family, code, tally.largest))
        .collect()
}

/// What the operator should know after an adjustment: bars without ends, codes that do not fit, a sigma0 that is not one.
pub(super) fn findings(network: &Network, stage: Stage) -> Vec<Finding> {
    let mut findings = Vec::new();
    let reached: Vec<&str> = bars_in_reach(network)
        .iter()
        .map(|(bar, _)| bar.name.as_str())
        .collect();
    for bar in network
        .scale_bars
        .iter()
        .filter(|bar| !reached.contains(&bar.name.as_str()))
    {
        let lost: Vec<&str> = [bar.from.as_str(), bar.to.as_str()]
            .into_iter()
            .filter(|end| {
                network
                    .point_of_label(end)
                    .map_or(true, |id| !network.points.contains_key(&id))
            })
            .collect();
        findings.push(Finding {
            stage,
            kind: FindingKind::ScaleBar,
            about: About::Bar(bar.name.clone()),
            text: format!(
                "bar '{}': found no coordinates of {}, expected both ends in two or more oriented images; not used",
                bar.name,
                lost.join(" and ")
            ),
        });
    }
    for (id, family, code, w) in misfitting_codes(network) {
        findings.push(Finding {
            stage,
            kind: FindingKind::DoubtfulCode,
            about: About::Image(id),
            text: format!(
                "{}: {} does not fit the network (|w| = {w:.1}); its dots are not used",
                network.images[&id].file.path,
                family.code_label(code)
            ),
        });
    }
    findings
}
