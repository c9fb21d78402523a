//! What the plots show, as numbers.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use crate::network::{CameraId, Network, PointId, PointKind};
use crate::ui::panels::facts::used_observations;

/// Width of a class of the histogram, in units of w.
pub(super) const CLASS: f64 = 0.25;

/// The histogram ends here; what lies beyond is counted in its outermost classes.
pub(super) const LARGEST_W: f64 = 5.0;

/// Most residual vectors drawn at once; beyond that they hide each other and the frame gets slow.
const MOST_VECTORS: usize = 4000;

/// A residual at its place in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ResidualVector {
    pub(super) place_px: Vector2<f64>,
    pub(super) residual_px: Vector2<f64>,
}

/// The residuals of one camera's images, laid over each other.
#[derive(Clone, Debug, Default)]
pub(super) struct CameraResiduals {
    pub(super) name: String,
    pub(super) width_px: f64,
    pub(super) height_px: f64,
    /// Every n-th observation where there are too many.
    pub(super) vectors: Vec<ResidualVector>,
    /// Observations of this camera.
    pub(super) count: usize,
    /// Root mean square length of all of them, px.
    pub(super) rms_px: f64,
}

/// A point with its precision.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PointSigma {
    pub(super) id: PointId,
    pub(super) label: String,
    pub(super) kind: PointKind,
    /// Standard deviations of x, y, z, mm.
    pub(super) sigma_mm: [f64; 3],
}

/// Everything the plots show.
#[derive(Clone, Debug, Default)]
pub(super) struct PlotData {
    pub(super) cameras: Vec<CameraResiduals>,
    /// Number of normalised residuals in each class from `-LARGEST_W` on.
    pub(super) histogram: Vec<usize>,
    /// Normalised residuals in the histogram.
    pub(super) normalised: usize,
    /// A-posteriori sigma of unit weight.
    pub(super) sigma0: f64,
    /// By label.
    pub(super) sigmas: Vec<PointSigma>,
    /// Points for each number of rays.
    pub(super) rays: BTreeMap<u32, usize>,
}

impl PlotData {
    pub(super) fn of(network: &Network) -> Self {
        let normalised = normalised_residuals(network);
        let sigma = |(id, point): (&PointId, &std::sync::Arc<crate::network::Point>)| {
            let variances = point.covariance?.diagonal();
            Some(PointSigma {
                id: *id,
                label: network.label(*id),
                kind: id.kind(),
                sigma_mm: [0, 1, 2].map(|i| variances[i].max(0.0).sqrt()),
            })
        };
        let mut rays = BTreeMap::new();
        for point in network.points.values() {
            *rays.entry(point.rays).or_default() += 1;
        }
        Self {
            cameras: camera_residuals(network),
            histogram: histogram(&normalised),
            normalised: normalised.len(),
            sigma0: network.adjustment.as_ref().map_or(1.0, |a| a.sigma0),
            sigmas: network.points.iter().filter_map(sigma).collect(),
            rays,
        }
    }
}

fn camera_residuals(network: &Network) -> Vec<CameraResiduals> {
    let mut of_camera: BTreeMap<CameraId, Vec<ResidualVector>> = BTreeMap::new();
    for observation in used_observations(network) {
        let Some(image) = network.images.get(&observation.image) else {
            continue;
        };
        let dots = image.detections.as_ref().map(|d| &d.dots);
        if let Some(dot) = dots.and_then(|d| d.get(observation.dot.slot())) {
            of_camera
                .entry(image.camera)
                .or_default()
                .push(ResidualVector {
                    place_px: dot.centre_px,
                    residual_px: observation.residual_px,
                });
        }
    }
    let camera = |(id, all): (CameraId, Vec<ResidualVector>)| {
        let entry = &network.cameras[&id];
        let squares: f64 = all.iter().map(|v| v.residual_px.norm_squared()).sum();
        let every = all.len().div_ceil(MOST_VECTORS).max(1);
        CameraResiduals {
            name: entry.name.clone(),
            width_px: f64::from(entry.camera.width_px),
            height_px: f64::from(entry.camera.height_px),
            count: all.len(),
            rms_px: (squares / all.len().max(1) as f64).sqrt(),
            vectors: all.into_iter().step_by(every).collect(),
        }
    };
    of_camera.into_iter().map(camera).collect()
}

/// Normalised residuals of x and y of the used observations.
///
/// An adjusted observation keeps the larger |w| only; the other follows from the residuals, because x and y of a dot
/// have the same sigma and very nearly the same redundancy number.
fn normalised_residuals(network: &Network) -> Vec<f64> {
    let mut all = Vec::new();
    for observation in used_observations(network) {
        let largest = observation.residual_px.amax();
        if largest > 0.0 && observation.test.is_finite() {
            let scale = observation.test / largest;
            all.extend(observation.residual_px.iter().map(|v| v * scale));
        }
    }
    all
}

fn histogram(normalised: &[f64]) -> Vec<usize> {
    let classes = (2.0 * LARGEST_W / CLASS) as usize;
    let mut counts = vec![0; classes];
    for w in normalised {
        let place = ((w + LARGEST_W) / CLASS).clamp(0.0, (classes - 1) as f64);
        counts[place as usize] += 1;
    }
    counts
}

/// The height of the normal curve with this sigma over a histogram of so many residuals.
pub(super) fn normal_curve(w: f64, sigma: f64, count: usize) -> f64 {
    let density = (-0.5 * (w / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt());
    density * CLASS * count as f64
}

/// A round exaggeration that draws a residual of three times the rms length as a tenth of the image's width.
pub(super) fn exaggeration(camera: &CameraResiduals) -> f64 {
    if camera.rms_px <= 0.0 {
        return 1.0;
    }
    let wanted = 0.1 * camera.width_px / (3.0 * camera.rms_px);
    let decade = 10_f64.powf(wanted.log10().floor());
    let steps = [5.0, 2.0, 1.0];
    let step = steps
        .into_iter()
        .find(|s| s * decade <= wanted)
        .unwrap_or(1.0);
    (step * decade).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::fixture::network;

    #[test]
    fn the_histogram_counts_every_residual_once() {
        let data = PlotData::of(&network());
        // Two used observations of image 1 and one of an image that is gone: x and y of three.
        assert_eq!(data.normalised, 6);
        assert_eq!(data.histogram.iter().sum::<usize>(), 6);
        let class = |w: f64| data.histogram[((w + LARGEST_W) / CLASS) as usize];
        // Residual (0.01, -0.02) px with |w| = 0.8 gives w = (0.4, -0.8).
        assert_eq!((class(0.4), class(-0.8)), (3, 3));
        assert_eq!(histogram(&[99.0, -99.0]).iter().sum::<usize>(), 2);
    }

    #[test]
    fn the_normal_curve_has_the_area_of_the_histogram() {
        let classes = (-200..200).map(|i| f64::from(i) * CLASS);
        let area: f64 = classes.map(|w| normal_curve(w, 1.3, 1000)).sum();
        assert!(
            (area - 1000.0).abs() < 1e-6,
            "a sum over a smooth density is exact: {area}"
        );
    }

    #[test]
    fn only_used_observations_with_a_dot_are_drawn() {
        let data = PlotData::of(&network());
        assert_eq!(data.cameras.len(), 1);
        assert_eq!(data.cameras[0].vectors.len(), 2);
        let wanted = 300.8 / (3.0 * 0.0005_f64.sqrt());
        let round = exaggeration(&data.cameras[0]);
        assert!(
            round <= wanted && round > wanted / 2.6,
            "{round} for {wanted}"
        );
    }

    #[test]
    fn points_are_counted_by_rays() {
        let data = PlotData::of(&network());
        assert_eq!(data.rays, BTreeMap::from([(2, 4)]));
        assert_eq!(data.sigmas.len(), 4);
    }
}
