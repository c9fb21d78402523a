//! How far rays really miss each other: between what the image measurement allows and what sigma_S allows.
//!
//! sigma_S holds the whole uncertainty of a station, but errors of place and of rotation compensate each other where the
//! targets are, so rays usually meet several times better than sigma_S says. The residuals of strong intersections tell.

use nalgebra::Vector3;

use super::intersection::{intersect, ray_variance};
use super::problem::{IdentificationInput, IdentificationSettings, Member};
use super::shape::Disc;
use super::sight::Sight;

/// Residuals from which a level for all views is taken.
const ENOUGH_FOR_ALL: usize = 40;
/// Residuals from which a view has a level of its own.
const ENOUGH_FOR_ONE: usize = 12;
/// Allowance for the error of the level itself and for systematic parts.
const ALLOWANCE: f64 = 1.15;
/// Least share of the common level that a single view is believed to have.
const LEAST_SHARE: f64 = 0.8;

/// Ray sigma of each view as sigma_S and the image tolerance have it, px.
pub(super) fn broad_sigmas(input: &IdentificationInput) -> Vec<f64> {
    let centre = input.space.centre();
    input
        .views
        .iter()
        .map(|view| {
            let focal_px = view.camera.interior.principal_distance / view.camera.pixel_pitch_mm;
            let distance = (view.pose.centre_in_world - centre).norm().max(1e-9);
            input
                .image_tolerance_px
                .hypot(input.station_sigma_mm * focal_px / distance)
        })
        .collect()
}

/// Ray sigma of each view from the residuals of strong intersections; `None` where there are too few.
pub(super) fn measured_sigmas(
    sights: &[Sight],
    strong: &[(&[Member], Vector3<f64>)],
    floor: f64,
    ceiling: &[f64],
) -> Option<Vec<f64>> {
    let mut by_view: Vec<Vec<f64>> = vec![Vec::new(); sights.len()];
    let mut all = Vec::new();
    for (members, point) in strong {
        let Some(fit) = intersect(sights, members, point) else {
            continue;
        };
        // The misfit is standardised, so the part of the noise that the point itself swallowed is already given back.
        for (member, misfit) in members.iter().zip(&fit.misfits) {
            let squared = misfit * ray_variance(&sights[member.view], member.dot);
            by_view[member.view].push(squared);
            all.push(squared);
        }
    }
    if all.len() < ENOUGH_FOR_ALL {
        return None;
    }
    let common = level(&mut all);
    Some(
        by_view
            .into_iter()
            .zip(ceiling)
            .map(|(mut squares, &ceiling)| {
                let own = if squares.len() < ENOUGH_FOR_ONE {
                    common
                } else {
                    level(&mut squares).max(LEAST_SHARE * common)
                };
                (ALLOWANCE * own).clamp(floor.min(ceiling), ceiling)
            })
            .collect(),
    )
}

/// How far ellipses may differ from the circle's image, in units of what the settings allow, from strong intersections:
/// real shapes scatter much less than the settings must allow for unknown blur.
pub(super) fn measured_shape_limit(
    sights: &[Sight],
    strong: &[(&[Member], Vector3<f64>)],
    settings: &IdentificationSettings,
) -> Option<f64> {
    /// The limit in medians: a normal scatter passes it once in 15,000.
    const MEDIANS: f64 = 6.0;
    /// Ellipses that fit better than this share of the settings' allowance are never refused.
    const LEAST: f64 = 0.3;
    let mut misfits = Vec::new();
    for (members, point) in strong {
        let Some(disc) = Disc::fitted(sights, members, point) else {
            continue;
        };
        misfits.extend(
            members
                .iter()
                .map(|m| disc.misfit(&sights[m.view], m.dot, point, settings)),
        );
    }
    if misfits.len() < ENOUGH_FOR_ALL {
        return None;
    }
    misfits.sort_by(f64::total_cmp);
    Some((MEDIANS * misfits[misfits.len() / 2]).clamp(LEAST, 1.0))
}

/// Sigma of a coordinate from squared lengths of plane residuals: their median is `2 ln 2` variances (Rayleigh).
fn level(squares: &mut [f64]) -> f64 {
    squares.sort_by(f64::total_cmp);
    (squares[squares.len() / 2] / (2.0 * std::f64::consts::LN_2)).sqrt()
}
