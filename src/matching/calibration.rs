//! How far rays really miss each other: between what the image measurement allows and what sigma_S allows.
//!
//! sigma_S holds the whole uncertainty of a station, but errors of place and of rotation compensate each other where the
//! targets are, so rays usually meet several times better than sigma_S says. The residuals of strong intersections tell.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::intersection::{Intersection, intersect, ray_covariance};
use super::problem::{IdentificationInput, Member};
use super::shape::{Disc, ShapeNoise};
use super::sight::Sight;
use crate::monitor::{Interrupted, Monitor};

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

/// Variance of each view's rays that nothing explains, px^2, from the residuals of strong intersections; `None` where there are too few.
///
/// Where the view's precision is told, it is what the residuals exceed it by; else it lies between `floor` and what sigma_S allows
/// (`ceiling`, px).
pub(super) fn measured_extras(
    sights: &[Sight],
    strong: &[(&[Member], Vector3<f64>)],
    floor: f64,
    ceiling: &[f64],
    monitor: &Monitor,
) -> Result<Option<Vec<f64>>, Interrupted> {
    let mut by_view: Vec<Vec<f64>> = vec![Vec::new(); sights.len()];
    let mut explained: Vec<(f64, usize)> = vec![(0.0, 0); sights.len()];
    let mut all = Vec::new();
    let fits: Vec<Option<Intersection>> = strong
        .par_iter()
        .map(|(members, point)| {
            monitor.check()?;
            Ok(intersect(sights, members, point))
        })
        .collect::<Result<_, Interrupted>>()?;
    for ((members, _), fit) in strong.iter().zip(fits) {
        monitor.check()?;
        let Some(fit) = fit else {
            continue;
        };
        // The misfit is standardised, so the part of the noise that the point itself swallowed is already given back.
        for (member, misfit) in members.iter().zip(&fit.misfits) {
            let sight = &sights[member.view];
            let Some(seen) = sight.sighting(&fit.point) else {
                continue;
            };
            let variance = ray_covariance(sight, member.dot, &seen).trace() / 2.0;
            let squared = misfit * variance;
            by_view[member.view].push(squared);
            let (sum, count) = &mut explained[member.view];
            *sum += variance - sight.extra_px2;
            *count += 1;
            all.push(squared);
        }
    }
    if all.len() < ENOUGH_FOR_ALL {
        return Ok(None);
    }
    let common = level(&mut all);
    let of_view = |((view, mut squares), &ceiling): ((usize, Vec<f64>), &f64)| {
        let own = if squares.len() < ENOUGH_FOR_ONE {
            common
        } else {
            level(&mut squares).max(LEAST_SHARE * common)
        };
        let (sum, count) = explained[view];
        let explained = sum / count.max(1) as f64;
        if sights[view].is_precise() {
            if count == 0 {
                return sights[view].extra_px2;
            }
            // What is only a little more than explained is chance.
            let more = own * own - explained * ALLOWANCE * ALLOWANCE;
            return (ALLOWANCE * ALLOWANCE * more).clamp(0.0, ceiling * ceiling);
        }
        let least = floor.min(ceiling);
        (ALLOWANCE * own).clamp(least, ceiling).powi(2)
    };
    Ok(Some(
        by_view
            .into_iter()
            .enumerate()
            .zip(ceiling)
            .map(of_view)
            .collect(),
    ))
}

/// How much larger the errors of ellipses are than the settings ask, from strong intersections.
pub(super) fn measured_shape_scale(
    sights: &[Sight],
    strong: &[(&[Member], Vector3<f64>)],
    noise: &ShapeNoise,
    monitor: &Monitor,
) -> Result<Option<f64>, Interrupted> {
    /// Median of chi-square with 3 degrees of freedom.
    const MEDIAN: f64 = 2.366;
    /// Ellipses are never trusted more than this, nor less than before anything was measured.
    const RANGE: [f64; 2] = [0.5, 6.0];
    let of_target = |(members, point): &(&[Member], Vector3<f64>)| {
        monitor.check()?;
        let Some(disc) = Disc::fitted(sights, members, point, noise) else {
            return Ok(Vec::new());
        };
        // Three numbers of the disc are taken from the ellipses themselves.
        let rays = members.len() as f64;
        let share = rays / (rays - 1.0).max(1.0);
        let misfits = members.iter().filter_map(|m| {
            let sight = &sights[m.view];
            sight.dots[m.dot].axes?;
            Some(share * disc.misfit(sight, m.dot, &sight.sighting(point)?, noise))
        });
        Ok(misfits.collect())
    };
    let by_target: Vec<Vec<f64>> = strong
        .par_iter()
        .map(of_target)
        .collect::<Result<_, Interrupted>>()?;
    let mut misfits: Vec<f64> = by_target.into_iter().flatten().collect();
    if misfits.len() < ENOUGH_FOR_ALL {
        return Ok(None);
    }
    misfits.sort_by(f64::total_cmp);
    let median = misfits[misfits.len() / 2];
    let scale = noise.scale * (median / MEDIAN).sqrt() * ALLOWANCE;
    Ok(Some(scale.clamp(RANGE[0], RANGE[1])))
}

/// Sigma of a coordinate from squared lengths of plane residuals: their median is `2 ln 2` variances (Rayleigh).
fn level(squares: &mut [f64]) -> f64 {
    squares.sort_by(f64::total_cmp);
    (squares[squares.len() / 2] / (2.0 * std::f64::consts::LN_2)).sqrt()
}
