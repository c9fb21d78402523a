//! The measurement as tables for other programs: points, observations, stations, cameras.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Matrix6, Vector2};

use super::csv_text::fixed;
use super::{CameraFile, cameras_toml, csv_text};
use crate::geometry::OmegaPhiKappa;
use crate::network::{
    AdjustedObservation, AdjustmentResult, ControlRole, ImageEntry, ImageId, InteriorSource, Label,
    Network, Point, PointId, Source, Standing,
};
use crate::targets::{Detections, DotIndex};

/// Decimals of lengths, mm.
const MM: usize = 6;
/// Decimals of standard deviations and angles.
const FINE: usize = 8;
/// Decimals of pixels.
const PX: usize = 5;
/// Decimals of rotation matrices.
const MATRIX: usize = 12;

/// Why figures of the adjustment cannot be given; one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoFigures {
    /// Nothing was adjusted.
    #[error("{what}: there is no adjustment yet; run the stages first")]
    Missing {
        /// What was asked for.
        what: &'static str,
    },
    /// The inputs have changed since.
    #[error("{what}: the adjustment is older than the last changes; run the stages again first")]
    Stale {
        /// What was asked for.
        what: &'static str,
    },
}

/// The adjustment where it belongs to the present inputs.
pub(super) fn fresh_adjustment<'a>(
    network: &'a Network,
    what: &'static str,
) -> Result<&'a AdjustmentResult, NoFigures> {
    match network.adjustment.as_deref() {
        None => Err(NoFigures::Missing { what }),
        Some(_) if !network.adjustment_is_fresh() => Err(NoFigures::Stale { what }),
        Some(adjustment) => Ok(adjustment),
    }
}

/// A point of the adjustment.
#[derive(Clone, Copy, Debug)]
pub(super) struct AdjustedPoint<'a> {
    pub(super) id: PointId,
    pub(super) point: &'a Point,
    /// A-posteriori covariance, mm^2.
    pub(super) covariance: &'a Matrix3<f64>,
}

/// The points that the adjustment computed, with every number there, by id.
pub(super) fn adjusted_points<'a>(
    network: &'a Network,
    adjustment: &AdjustmentResult,
) -> Vec<AdjustedPoint<'a>> {
    let observed: BTreeSet<PointId> = adjustment
        .observations
        .iter()
        .filter(|o| o.standing == Standing::Used)
        .map(|o| o.point)
        .collect();
    let adjusted = |(&id, point): (&PointId, &'a std::sync::Arc<Point>)| {
        let covariance = point.covariance.as_ref()?;
        let finite = point
            .position
            .iter()
            .chain(covariance)
            .all(|v| v.is_finite());
        (finite && observed.contains(&id)).then_some(AdjustedPoint {
            id,
            point,
            covariance,
        })
    };
    network.points.iter().filter_map(adjusted).collect()
}

/// The adjusted points: `label,kind,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,rays`.
///
/// # Errors
/// [`NoFigures`] without an adjustment of the present inputs.
pub fn export_points(network: &Network) -> Result<String, NoFigures> {
    let adjustment = fresh_adjustment(network, "export of points")?;
    let control: BTreeSet<PointId> = network
        .control
        .iter()
        .filter(|c| c.role != ControlRole::Check)
        .filter_map(|c| network.point_of_label(&c.label).ok())
        .collect();
    let rows = adjusted_points(network, adjustment).into_iter().map(|p| {
        let kind = if control.contains(&p.id) {
            "control".to_owned()
        } else {
            p.id.kind().to_string()
        };
        let mut row = vec![network.label(p.id), kind];
        row.extend(p.point.position.iter().map(|&v| fixed(v, MM)));
        row.extend((0..3).map(|i| fixed(sigma(p.covariance[(i, i)]), FINE)));
        row.push(p.point.rays.to_string());
        row
    });
    Ok(csv_text(
        "label,kind,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,rays",
        rows,
    ))
}

/// A standard deviation; rounding may leave variances of fixed quantities a little below zero.
fn sigma(variance: f64) -> f64 {
    variance.max(0.0).sqrt()
}

/// Every detected dot of every image in use:
/// `image,label,x_px,y_px,sigma_px,vx_px,vy_px,redundancy,test,status,source,reason,ecc_x_px,ecc_y_px`.
///
/// A dot that is `used` has residuals; before any adjustment none is.
///
/// # Errors
/// [`NoFigures::Stale`] where the adjustment is older than the inputs.
pub fn export_observations(network: &Network) -> Result<String, NoFigures> {
    let adjustment = match fresh_adjustment(network, "export of observations") {
        Ok(adjustment) => Some(adjustment),
        Err(NoFigures::Missing { .. }) => None,
        Err(stale) => return Err(stale),
    };
    let observations: BTreeMap<(ImageId, DotIndex), &AdjustedObservation> = adjustment
        .iter()
        .flat_map(|a| &a.observations)
        .map(|o| ((o.image, o.dot), o))
        .collect();
    let mut rows = Vec::new();
    for (id, image) in network.used_images() {
        let Some(detections) = &image.detections else {
            continue;
        };
        let set_aside = dots_set_aside(image, detections);
        for (index, dot) in (0..).map(DotIndex).zip(&detections.dots) {
            let label = image.labels.get(&index);
            let observation = observations
                .get(&(id, index))
                .copied()
                .filter(|o| label.is_some_and(|l| l.point == o.point));
            let standing = match label {
                Some(label) => standing(network, image, label, observation),
                None => DotStanding {
                    status: "unlabelled",
                    reason: image
                        .unlabelled
                        .get(&index)
                        .or_else(|| set_aside.get(&index))
                        .cloned()
                        .unwrap_or_else(|| match image.station {
                            Some(_) => "not identified".to_owned(),
                            None => "its image has no orientation".to_owned(),
                        }),
                },
            };
            let source = match label.map(|l| l.source) {
                Some(Source::Operator) => "operator",
                _ => "automatic",
            };
            let mut row = vec![
                image.file.path.clone(),
                label.map(|l| network.label(l.point)).unwrap_or_default(),
                fixed(dot.centre_px.x, PX),
                fixed(dot.centre_px.y, PX),
                fixed(dot.sigma_px, PX),
            ];
            row.extend(match observation {
                Some(o) => [
                    fixed(o.residual_px.x, PX),
                    fixed(o.residual_px.y, PX),
                    fixed(o.redundancy, 4),
                    fixed(o.test, 3),
                ],
                None => Default::default(),
            });
            row.extend([
                standing.status.to_owned(),
                source.to_owned(),
                standing.reason,
            ]);
            let eccentricity = label.and_then(|label| eccentricity(network, image, label));
            row.extend(match eccentricity {
                Some(e) => [fixed(e.x, PX), fixed(e.y, PX)],
                None => Default::default(),
            });
            rows.push(row);
        }
    }
    Ok(csv_text(
        "image,label,x_px,y_px,sigma_px,vx_px,vy_px,redundancy,test,status,source,reason,ecc_x_px,ecc_y_px",
        rows,
    ))
}

/// Image of the target's centre less the centre of its image, px, where its circle and the image's orientation are known.
fn eccentricity(network: &Network, image: &ImageEntry, label: &Label) -> Option<Vector2<f64>> {
    let point = network.points.get(&label.point)?;
    let camera = &network.camera_of(image).camera;
    let pose = &image.station.as_ref()?.pose;
    camera.eccentricity(pose, &point.position, point.circle.as_ref()?)
}

struct DotStanding {
    status: &'static str,
    reason: String,
}

/// Whether a labelled dot is used, and why not.
fn standing(
    network: &Network,
    image: &ImageEntry,
    label: &Label,
    observation: Option<&AdjustedObservation>,
) -> DotStanding {
    let rejected = |reason: String| DotStanding {
        status: "rejected",
        reason,
    };
    if let Some(reason) = &label.rejected {
        return rejected(reason.clone());
    }
    match observation.map(|o| o.standing) {
        Some(Standing::Used) => DotStanding {
            status: "used",
            reason: String::new(),
        },
        Some(Standing::Rejected) => rejected("it failed the test for outliers".to_owned()),
        None if network.adjustment.is_none() => rejected("there is no adjustment yet".to_owned()),
        None if image.station.is_none() => rejected(match &image.attempt {
            Some(attempt) => format!("the image is not oriented: {}", attempt.reason),
            None => "the image is not oriented".to_owned(),
        }),
        None => rejected("the adjustment does not hold its point: too few rays".to_owned()),
    }
}

/// The dots of code readings that were set aside, with the reason.
fn dots_set_aside(image: &ImageEntry, detections: &Detections) -> BTreeMap<DotIndex, String> {
    let mut reasons = BTreeMap::new();
    for (&place, reason) in image.set_aside.iter() {
        if let Some(reading) = detections.codes.get(place) {
            let label = reading.family.code_label(reading.id);
            for &dot in &reading.dots {
                reasons.insert(dot, format!("read as {label} and set aside: {reason}"));
            }
        }
    }
    reasons
}

/// The oriented images: centre, rotation matrix, angles, and their standard deviations.
///
/// # Errors
/// [`NoFigures`] without an adjustment of the present inputs.
pub fn export_stations(network: &Network) -> Result<String, NoFigures> {
    fresh_adjustment(network, "export of stations")?;
    let degrees = |v: f64| fixed(v.to_degrees(), FINE);
    let rows = network.oriented_images().map(|(_, image, station)| {
        let angles = OmegaPhiKappa::from_rotation(&station.pose.camera_from_world);
        let matrix = station.pose.camera_from_world.matrix().transpose();
        let mut row = vec![image.file.path.clone()];
        row.extend(station.pose.centre_in_world.iter().map(|&v| fixed(v, MM)));
        // The transposed matrix in nalgebra's column order is the matrix row by row.
        row.extend(matrix.iter().map(|&v| fixed(v, MATRIX)));
        row.extend([angles.omega, angles.phi, angles.kappa].map(degrees));
        row.extend(match &station.covariance {
            Some(covariance) => station_sigmas(covariance, &angles),
            None => Default::default(),
        });
        row
    });
    Ok(csv_text(
        "image,x_mm,y_mm,z_mm,m11,m12,m13,m21,m22,m23,m31,m32,m33,omega_deg,phi_deg,kappa_deg,sigma_x_mm,sigma_y_mm,sigma_z_mm,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg",
        rows,
    ))
}

/// Sigmas of the centre (mm) and of omega, phi, kappa (degrees).
fn station_sigmas(covariance: &Matrix6<f64>, angles: &OmegaPhiKappa) -> [String; 6] {
    let turn = covariance.fixed_view::<3, 3>(0, 0);
    let jacobian = angles.jacobian_by_turn();
    let of_angles = jacobian * turn * jacobian.transpose();
    std::array::from_fn(|i| {
        if i < 3 {
            fixed(sigma(covariance[(3 + i, 3 + i)]), FINE)
        } else {
            fixed(sigma(of_angles[(i - 3, i - 3)]).to_degrees(), FINE)
        }
    })
}

/// The cameras as a camera file: present estimates, with the sigmas of the adjustment where there are any.
///
/// # Errors
/// [`NoFigures::Stale`] where the adjustment is older than the inputs.
pub fn export_cameras(network: &Network) -> Result<String, NoFigures> {
    let adjustment = match fresh_adjustment(network, "export of cameras") {
        Ok(adjustment) => Some(adjustment),
        Err(NoFigures::Missing { .. }) => None,
        Err(stale) => return Err(stale),
    };
    let cameras: Vec<CameraFile> = network
        .cameras
        .iter()
        .map(|(id, entry)| {
            let result = adjustment.and_then(|a| a.cameras.iter().find(|c| c.camera == *id));
            let known = result.is_some() || entry.source != InteriorSource::Unknown;
            let interior = &entry.camera.interior;
            CameraFile {
                name: entry.name.clone(),
                width_px: entry.camera.width_px,
                height_px: entry.camera.height_px,
                pixel_pitch_mm: Some(entry.camera.pixel_pitch_mm),
                principal_distance_mm: known.then_some(interior.principal_distance),
                principal_point: interior.principal_point,
                radial: interior.radial,
                tangential: interior.tangential,
                affinity: interior.affinity,
                direction: interior.direction,
                known_sigmas: match result {
                    None => entry.known_sigmas,
                    // A parameter without variance was not estimated: there is nothing to weight it with.
                    Some(result) => std::array::from_fn(|i| {
                        Some(sigma(result.covariance[(i, i)])).filter(|s| *s > 0.0)
                    }),
                },
            }
        })
        .collect();
    Ok(cameras_toml(&cameras))
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;
    use crate::geometry::Circle;
    use nalgebra::Vector3;
    use std::sync::Arc;

    fn fields(line: &str) -> Vec<&str> {
        line.split(',').collect()
    }

    #[test]
    fn points_are_the_adjusted_ones_with_every_number() {
        let csv = export_points(&fixture::network()).unwrap();
        assert_eq!(
            csv,
            "label,kind,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,rays\n\
             C1.O,control,100.000000,0.000000,-50.250000,0.01000000,0.02000000,0.03000000,2\n\
             X1,cross,0.000000,0.000000,40.000000,0.01000000,0.02000000,0.03000000,2\n\
             M1,target,1.000000,2.000000,3.000000,0.01000000,0.02000000,0.03000000,2\n"
        );
    }

    #[test]
    fn figures_older_than_the_inputs_are_refused_in_one_line() {
        let mut network = fixture::network();
        network.inputs += 1;
        for (error, what) in [
            (export_points(&network), "points"),
            (export_observations(&network), "observations"),
            (export_stations(&network), "stations"),
            (export_cameras(&network), "cameras"),
        ] {
            assert_eq!(
                error.unwrap_err().to_string(),
                format!(
                    "export of {what}: the adjustment is older than the last changes; run the stages again first"
                )
            );
        }
        network.adjustment = None;
        assert_eq!(
            export_points(&network).unwrap_err().to_string(),
            "export of points: there is no adjustment yet; run the stages first"
        );
        let csv = export_observations(&network).unwrap();
        assert!(!csv.contains(",used,"), "{csv}");
    }

    #[test]
    fn every_dot_of_every_used_image_is_an_observation() {
        let csv = export_observations(&fixture::network()).unwrap();
        assert_eq!(
            csv,
            "image,label,x_px,y_px,sigma_px,vx_px,vy_px,redundancy,test,status,source,reason,ecc_x_px,ecc_y_px\n\
             img_1.png,C1.O,10.00000,20.00000,0.02000,0.01000,-0.02000,1.2000,0.800,used,automatic,,,\n\
             img_1.png,M1,11.00000,20.00000,0.02000,3.00000,0.00000,0.0000,9.000,rejected,automatic,residual 3 px,,\n\
             img_1.png,X1,12.00000,20.00000,0.02000,0.01000,-0.02000,1.2000,0.800,used,operator,,,\n\
             img_1.png,C2.O,13.00000,20.00000,0.02000,,,,,rejected,automatic,the adjustment does not hold its point: too few rays,,\n\
             img_1.png,,14.00000,20.00000,0.02000,,,,,unlabelled,automatic,two points are as near,,\n\
             img_1.png,,15.00000,20.00000,0.02000,,,,,unlabelled,automatic,read as R14-5 and set aside: it does not fit,,\n\
             img_1.png,,16.00000,20.00000,0.02000,,,,,unlabelled,automatic,not identified,,\n\
             img_2.png,C1.O,10.00000,20.00000,0.02000,,,,,rejected,automatic,the image is not oriented: too few codes,,\n"
        );
    }

    #[test]
    fn eccentricity_is_told_where_the_circle_is_known() {
        let mut network = fixture::network();
        let cross: PointId = "cross:1".parse().unwrap();
        let points = Arc::make_mut(&mut network.points);
        let point = Arc::make_mut(points.get_mut(&cross).unwrap());
        let circle = Circle {
            normal: Vector3::new(0.6, 0.0, 0.8),
            radius_mm: 20.0,
        };
        point.circle = Some(circle);
        let place = point.position;
        let csv = export_observations(&network).unwrap();
        let (_, image, station) = network.oriented_images().next().unwrap();
        let camera = &network.camera_of(image).camera;
        let expected = camera.eccentricity(&station.pose, &place, &circle).unwrap();
        assert!(expected.norm() > 0.01, "{expected}");
        for line in csv.lines().skip(1) {
            let row = fields(line);
            if row[1] == "X1" {
                let told = Vector2::new(row[12].parse().unwrap(), row[13].parse().unwrap());
                assert!((told - expected).amax() <= 0.5e-5 + 1e-12);
            } else {
                assert_eq!(row[12..], ["", ""], "{line}");
            }
        }
    }

    #[test]
    fn stations_are_exported_with_matrix_angles_and_sigmas() {
        let network = fixture::network();
        let csv = export_stations(&network).unwrap();
        let mut lines = csv.lines();
        let header = fields(lines.next().unwrap());
        assert_eq!(
            header.join(","),
            "image,x_mm,y_mm,z_mm,m11,m12,m13,m21,m22,m23,m31,m32,m33,omega_deg,phi_deg,kappa_deg,sigma_x_mm,sigma_y_mm,sigma_z_mm,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg"
        );
        let row = fields(lines.next().unwrap());
        assert_eq!(lines.next(), None, "img_2 has no orientation");
        let number = |name: &str| -> f64 {
            let index = header.iter().position(|h| *h == name).unwrap();
            row[index].parse().unwrap()
        };
        let phi = number("phi_deg").to_radians();
        let omega = number("omega_deg").to_radians();
        // Angles are written to 1e-8 degrees.
        assert!((number("m31") - phi.sin()).abs() < 1e-9);
        assert!((number("m32") + phi.cos() * omega.sin()).abs() < 1e-9);
        assert!((number("sigma_y_mm") - 0.2).abs() < 1e-8);
        let station = network.oriented_images().next().unwrap().2;
        let m = station.pose.camera_from_world.matrix();
        assert!((number("m12") - m[(0, 1)]).abs() < 1e-11);
        // Equal sigmas of the turn about all axes leave omega with sigma / cos phi.
        let expected = (1e-4 / phi.cos()).to_degrees();
        assert!((number("sigma_omega_deg") - expected).abs() < 1e-8);
        assert!((number("sigma_phi_deg") - 1e-4_f64.to_degrees()).abs() < 1e-8);
    }

    #[test]
    fn cameras_are_read_back() {
        let network = fixture::network();
        let text = export_cameras(&network).unwrap();
        let interior = network.cameras.values().next().unwrap().camera.interior;
        let table: toml::Table = text.parse().unwrap();
        assert_eq!(
            table["principal_distance_mm"].as_float(),
            Some(interior.principal_distance)
        );
        assert_eq!(table["sigma_principal_distance_mm"].as_float(), Some(0.5));
        let sigmas = table["sigma_radial"].as_array().unwrap();
        assert_eq!(sigmas[0].as_float(), Some(0.25));
        assert_eq!(sigmas[2].as_float(), Some(f64::INFINITY), "K3 was fixed");
        assert!(!table.contains_key("sigma_affinity"));
    }

    #[test]
    fn a_point_without_covariance_is_no_adjusted_point() {
        let mut network = fixture::network();
        for point in Arc::make_mut(&mut network.points).values_mut() {
            Arc::make_mut(point).covariance = None;
        }
        assert_eq!(export_points(&network).unwrap().lines().count(), 1);
    }
}
