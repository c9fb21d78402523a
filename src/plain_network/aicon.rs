//! AICON bundle files: `.ior` (cameras), `.eor` (orientations), `.obc` (points), `.phc` (image points), `.scale` (bars).

use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector3};

use super::rows::Row;
use super::{
    DatumPoints, ImportError, ImportPlace, NamedText, PlainCamera, PlainDatum, PlainDistance,
    PlainImage, PlainNetwork, PlainObservation, PlainParameter, PlainPoint,
};
use crate::adjustment::{ResidualPlane, Sharing};
use crate::camera::LensDirection;
use crate::geometry::{OmegaPhiKappa, Pose};
use crate::network::BarRole;

/// Sigma of every image coordinate, mm. The columns sx and sy of `.phc` are no weights: the protocol of the program
/// weights by this one, and by larger ones where its user said so, which is in none of its files.
pub const AICON_SIGMA_MM: f64 = 0.0005;

/// The texts of a bundle.
#[derive(Clone, Copy, Debug)]
pub struct AiconTexts<'a> {
    /// `.ior`.
    pub cameras: NamedText<'a>,
    /// `.eor`.
    pub orientations: NamedText<'a>,
    /// `.obc`.
    pub points: NamedText<'a>,
    /// `.phc`.
    pub image_points: NamedText<'a>,
    /// `.scale`.
    pub bars: Option<NamedText<'a>>,
}

/// Free in the bundle: c, x0, y0, A1, A2 (our K1, K2), B1, B2 (our P1, P2). A3 and the affinity C1, C2 (our B1, B2)
/// are held.
const FREE: [bool; 10] = [
    true, true, true, true, true, false, true, true, false, false,
];

/// Reads a bundle.
///
/// The lens is displacing and balanced at R0; Ck is our -c, and the rotation `Rx(omega) Ry(phi) Rz(kappa)` is our
/// world-from-camera. Image coordinates, in the files millimetres with x right and y up, become pixels by the pitch
/// that the sensor's width and columns give. Points are those of `.obc` whose first flag is 1, observations the rows of
/// `.phc` with the flags 1 1 1 on such a point; the published orientations and points are the starts. The datum is
/// inner constraints on all points, with the scale of the bars.
///
/// # Errors
/// [`ImportError`], one line.
pub fn from_aicon(texts: AiconTexts<'_>) -> Result<PlainNetwork, ImportError> {
    let cameras = read_cameras(texts.cameras)?;
    let images = read_orientations(texts.orientations, &cameras)?;
    let points = read_points(texts.points)?;
    let network = PlainNetwork {
        observations: read_image_points(texts.image_points, &cameras, &images, &points)?,
        distances: match texts.bars {
            Some(bars) => read_bars(bars, &points)?,
            None => Vec::new(),
        },
        cameras,
        images,
        points,
        datum: PlainDatum::InnerConstraints(DatumPoints::All),
        residuals: ResidualPlane::Measured,
        object: None,
    };
    match network.check() {
        Ok(()) => Ok(network),
        Err(fault) => Err(match (fault.kind(), texts.bars) {
            ("camera", _) => texts.cameras.fault(fault),
            ("image", _) => texts.orientations.fault(fault),
            ("point", _) => texts.points.fault(fault),
            ("distance", Some(bars)) => bars.fault(fault),
            _ => texts.image_points.fault(fault),
        }),
    }
}

/// Five lines a camera: number, -, Ck, Xh, Yh, A1, A2, R0 / A3 / B1, B2 / C1, C2 / width and height in mm and pixels.
fn read_cameras(source: NamedText<'_>) -> Result<Vec<PlainCamera>, ImportError> {
    let rows: Vec<Row<'_>> = source.words().collect();
    if rows.is_empty() {
        return Err(source.unexpected(ImportPlace::File, "nothing", "a camera in five lines"));
    }
    rows.chunks(5).map(read_camera).collect()
}

fn read_camera(rows: &[Row<'_>]) -> Result<PlainCamera, ImportError> {
    let [first, radial, decentring, affinity, sensor] = rows else {
        let found = format!("a camera in {} lines", rows.len());
        return Err(rows[0].unexpected(found, "five lines"));
    };
    let name = first.text(0, "camera")?;
    let [ck, x0, y0, a1, a2] = first.numbers(2, ["Ck", "Xh", "Yh", "A1", "A2"])?;
    if ck >= 0.0 {
        return Err(first.wrong(2, "Ck", "a number less than 0"));
    }
    let r0 = first.positive(7, "R0")?;
    let a3 = radial.number(0, "A3")?;
    let [b1, b2] = decentring.numbers(0, ["B1", "B2"])?;
    let [c1, c2] = affinity.numbers(0, ["C1", "C2"])?;
    let width_mm = sensor.positive(0, "width in mm")?;
    let width_px = sensor.side(2, "width in pixels")?;
    Ok(PlainCamera {
        name: name.to_owned(),
        width_px,
        height_px: sensor.side(3, "height in pixels")?,
        pixel_pitch_mm: width_mm / f64::from(width_px),
        lens: LensDirection::Displacing {
            balanced_radius_mm: r0,
        },
        values: [-ck, x0, y0, a1, a2, a3, b1, b2, c1, c2],
        parameters: FREE.map(|free| match free {
            true => PlainParameter::Free,
            false => PlainParameter::Fixed,
        }),
        sharing: [Sharing::Camera; 10],
    })
}

/// Image, camera, X, Y, Z, omega, phi, kappa in radians.
fn read_orientations(
    source: NamedText<'_>,
    cameras: &[PlainCamera],
) -> Result<Vec<PlainImage>, ImportError> {
    let read = |row: Row<'_>| {
        let camera = row.text(1, "camera")?;
        let camera = cameras.iter().position(|known| known.name == camera);
        let centre = row.numbers(2, ["X", "Y", "Z"])?;
        let [omega, phi, kappa] = row.numbers(5, ["omega", "phi", "kappa"])?;
        Ok(PlainImage {
            name: row.text(0, "image")?.to_owned(),
            camera: camera.ok_or_else(|| row.wrong(1, "camera", "a camera of the .ior file"))?,
            start: Some(Pose {
                camera_from_world: OmegaPhiKappa { omega, phi, kappa }.rotation(),
                centre_in_world: Vector3::from(centre),
            }),
        })
    };
    source.words().map(read).collect()
}

/// Point, X, Y, Z, their sigmas, rays, three flags of which the first says that the point was adjusted.
fn read_points(source: NamedText<'_>) -> Result<Vec<PlainPoint>, ImportError> {
    let mut points = Vec::new();
    for row in source.words() {
        row.at_least(&["point", "X", "Y", "Z", "sX", "sY", "sZ", "rays", "flag"])?;
        let point = PlainPoint::new(
            row.text(0, "point")?,
            Some(row.numbers(1, ["X", "Y", "Z"])?),
        );
        if flag(&row, 8)? {
            points.push(point);
        }
    }
    Ok(points)
}

/// Image, point, x, y in mm, sx, sy, vx, vy, three flags that are all 1 where the point was used.
fn read_image_points(
    source: NamedText<'_>,
    cameras: &[PlainCamera],
    images: &[PlainImage],
    points: &[PlainPoint],
) -> Result<Vec<PlainObservation>, ImportError> {
    let image_of: BTreeMap<&str, usize> = places(images.iter().map(|i| i.name.as_str()));
    let point_of: BTreeMap<&str, usize> = places(points.iter().map(|p| p.name.as_str()));
    let mut observations = Vec::new();
    for row in source.words() {
        row.at_least(&[
            "image", "point", "x", "y", "sx", "sy", "vx", "vy", "flag", "flag", "flag",
        ])?;
        let used = flag(&row, 8)? & flag(&row, 9)? & flag(&row, 10)?;
        let (true, Some(&point)) = (used, point_of.get(row.text(1, "point")?)) else {
            continue;
        };
        let Some(&image) = image_of.get(row.text(0, "image")?) else {
            return Err(row.wrong(0, "image", "an image of the .eor file"));
        };
        let camera = &cameras[images[image].camera];
        let pixel = camera.pixel_from_image(&Vector2::from(row.numbers(2, ["x", "y"])?));
        observations.push(PlainObservation {
            image,
            point,
            x_px: pixel.x,
            y_px: pixel.y,
            sigma_px: AICON_SIGMA_MM / camera.pixel_pitch_mm,
        });
    }
    Ok(observations)
}

/// Number, name in quotes, from, to, length and sigma in mm, a flag that is 1 where the bar was used.
fn read_bars(
    source: NamedText<'_>,
    points: &[PlainPoint],
) -> Result<Vec<PlainDistance>, ImportError> {
    let point_of: BTreeMap<&str, usize> = places(points.iter().map(|p| p.name.as_str()));
    let mut bars = Vec::new();
    for (line, content) in source.lines() {
        let mut parts = content.splitn(3, '"');
        let (Some(_), Some(name), Some(rest)) = (parts.next(), parts.next(), parts.next()) else {
            let place = ImportPlace::Line(line);
            return Err(source.unexpected(place, "no name in quotes", "one after the number"));
        };
        let row = source.words_of(line, rest);
        let end = |index, field| {
            let name = row.text(index, field)?;
            let point = point_of.get(name).copied();
            point.ok_or_else(|| row.wrong(index, field, "an adjusted point of the .obc file"))
        };
        let (from, to) = (end(0, "from")?, end(1, "to")?);
        bars.push(PlainDistance {
            // Bars of one kind share a name.
            name: format!("{name} {}-{}", points[from].name, points[to].name),
            from,
            to,
            length_mm: row.positive(2, "length")?,
            sigma_mm: row.positive(3, "sigma")?,
            role: match flag(&row, 4)? {
                true => BarRole::Control,
                false => BarRole::Check,
            },
            expansion: None,
        });
    }
    Ok(bars)
}

fn flag(row: &Row<'_>, index: usize) -> Result<bool, ImportError> {
    match row.fields.get(index) {
        Some(&"1") => Ok(true),
        Some(&"0") => Ok(false),
        _ => Err(row.wrong(index, "flag", "0 or 1")),
    }
}

fn places<'a>(names: impl Iterator<Item = &'a str>) -> BTreeMap<&'a str, usize> {
    names
        .enumerate()
        .map(|(index, name)| (name, index))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{assert_comes_back, displaced, ideal, rms};
    use super::super::real_data::{data, say, text_of};
    use super::*;

    const CAMERA: &str =
        "1 -999 -28.8 0.1 -0.2 -1e-4 1e-7 13\n0\n1e-6 2e-6\n3e-5 4e-5\n36 24 8000 6000\n";
    const ORIENTATION: &str = "7 1 0 0 1000 0 0 0 0 307 3\n";
    const POINTS: &str =
        "5 1 2 3 .1 .1 .1 9 1 1 0\n6 4 2 3 .1 .1 .1 9 1 1 0\n9 0 0 0 .1 .1 .1 9 0 1 0\n";

    fn read(
        [cameras, orientations, points, image_points, bars]: [&str; 5],
    ) -> Result<PlainNetwork, ImportError> {
        let named = |file, text| NamedText { file, text };
        from_aicon(AiconTexts {
            cameras: named("a.ior", cameras),
            orientations: named("a.eor", orientations),
            points: named("a.obc", points),
            image_points: named("a.phc", image_points),
            bars: Some(named("a.scale", bars)),
        })
    }

    #[test]
    fn a_bundle_is_read() {
        let seen = "7 5 1.5 -0.75 0 0 0 0 1 1 1\n7 6 1 1 0 0 0 0 1 0 1\n7 9 1 1 0 0 0 0 1 1 1\n";
        let bar = "0 \"Scale bar\" 5 6 3.0 0.01 1\n";
        let network = read([CAMERA, ORIENTATION, POINTS, seen, bar]).unwrap();
        let camera = &network.cameras[0];
        assert_eq!(
            camera.values,
            [28.8, 0.1, -0.2, -1e-4, 1e-7, 0.0, 1e-6, 2e-6, 3e-5, 4e-5]
        );
        assert_eq!(camera.pixel_pitch_mm, 0.0045);
        assert_eq!(network.points.len(), 2);
        let [seen] = network.observations[..] else {
            panic!("one observation")
        };
        let back = camera.image_from_pixel(&Vector2::new(seen.x_px, seen.y_px));
        assert!((back - Vector2::new(1.5, -0.75)).norm() < 1e-12);
        assert!(seen.y_px > 3000.0, "y is up in the file, down in pixels");
        assert_eq!(network.distances[0].name, "Scale bar 5-6");
    }

    #[test]
    fn bad_files_are_answered_in_one_line() {
        let seen = "7 5 1.5 -0.75 0 0 0 0 1 1 1\n";
        let bar = "0 \"b\" 5 6 3.0 0.01 1\n";
        for (texts, line) in [
            (
                ["", ORIENTATION, POINTS, seen, bar],
                "a.ior: found nothing, expected a camera in five lines",
            ),
            (
                ["1 2 3\n", ORIENTATION, POINTS, seen, bar],
                "a.ior, line 1: found a camera in 1 lines, expected five lines",
            ),
            (
                [
                    &CAMERA.replace("-28.8", "28.8"),
                    ORIENTATION,
                    POINTS,
                    seen,
                    bar,
                ],
                "a.ior, line 1, column 3 (Ck): found '28.8', expected a number less than 0",
            ),
            (
                [CAMERA, "7 2 0 0 1000 0 0 0\n", POINTS, seen, bar],
                "a.eor, line 1, column 2 (camera): found '2', expected a camera of the .ior file",
            ),
            (
                [CAMERA, "7 1 0 0 1000 0 nan 0\n", POINTS, seen, bar],
                "a.eor, line 1, column 7 (phi): found 'nan', expected a finite number",
            ),
            (
                [CAMERA, ORIENTATION, "5 1 2\n", seen, bar],
                "a.obc, line 1: found 3 fields, expected 9 (point, X, Y, Z, sX, sY, sZ, rays, flag)",
            ),
            (
                [
                    CAMERA,
                    ORIENTATION,
                    POINTS,
                    "8 5 1.5 -0.75 0 0 0 0 1 1 1\n",
                    bar,
                ],
                "a.phc, line 1, column 1 (image): found '8', expected an image of the .eor file",
            ),
            (
                [CAMERA, ORIENTATION, POINTS, &seen.repeat(2), bar],
                "a.phc, observation 2 of point '5' in image '7': found a second one of it, expected one",
            ),
            (
                [CAMERA, ORIENTATION, POINTS, seen, "0 bar 5 6 3 1 1"],
                "a.scale, line 1: found no name in quotes, expected one after the number",
            ),
            (
                [CAMERA, ORIENTATION, POINTS, seen, "0 \"b\" 5 9 3 1 1"],
                "a.scale, line 1, column 2 (to): found '9', expected an adjusted point of the .obc file",
            ),
        ] {
            assert_eq!(read(texts).unwrap_err().to_string(), line);
        }
    }

    #[test]
    fn the_published_bundle_projects_onto_its_image_points() {
        let Some(folder) = data("aicon-bundle") else {
            return;
        };
        let texts = ["ior", "eor", "obc", "phc", "scale"]
            .map(|end| text_of(&folder, &format!("example.{end}")));
        let network = read(texts.each_ref().map(String::as_str)).unwrap();
        assert_eq!(network.images.len(), 115);
        assert_eq!(network.points.len(), 150);
        assert_eq!(network.observations.len(), 9972);
        assert_comes_back(&network);
        // vx and vy as the files print them, in the order of the observations.
        let printed = printed_residuals(&texts[3], &network);
        let mut exact = network.clone();
        // The protocol's camera has more digits than the .ior file.
        exact.cameras[0].values = [
            28.78507,
            0.01734892,
            0.05668731,
            -1.096069e-4,
            1.495660e-7,
            0.0,
            5.798428e-6,
            -8.644540e-6,
            -7.00801e-5,
            -3.12627e-5,
        ];
        for (network, name, most) in [(&network, ".ior", 8e-6), (&exact, "protocol", 6e-6)] {
            let residuals = residuals(network);
            let off: Vec<Vector2<f64>> =
                residuals.iter().zip(&printed).map(|(a, b)| a - b).collect();
            let largest = off.iter().map(Vector2::amax).fold(0.0, f64::max);
            say(&format!(
                "aicon-bundle, camera of the {name}: residuals rms {:.6} mm, differences from the printed ones rms {:.1e}, largest {largest:.1e} mm",
                rms(&residuals),
                rms(&off)
            ));
            // sqrt((0.000418^2 + 0.000369^2) / 2) of the protocol.
            assert!((rms(&residuals) - 0.000394).abs() < 1e-6);
            // Points printed to 1e-4 mm some 300 mm from a camera are good to 5e-6 mm in its image.
            assert!(rms(&off) < most / 3.0 && largest < most, "{largest}");
        }
    }

    fn residuals(network: &PlainNetwork) -> Vec<Vector2<f64>> {
        let residual = |seen: &PlainObservation| {
            let image = &network.images[seen.image];
            let camera = &network.cameras[image.camera];
            let point = network.points[seen.point].start.unwrap();
            let computed = displaced(camera, &ideal(camera, &image.start.unwrap(), point));
            computed - camera.image_from_pixel(&Vector2::new(seen.x_px, seen.y_px))
        };
        network.observations.iter().map(residual).collect()
    }

    fn printed_residuals(text: &str, network: &PlainNetwork) -> Vec<Vector2<f64>> {
        let known = |name: &str| network.points.iter().any(|point| point.name == name);
        text.lines()
            .map(|line| line.split_whitespace().collect::<Vec<_>>())
            .filter(|fields| fields[8..11] == ["1", "1", "1"] && known(fields[1]))
            .map(|fields| Vector2::new(fields[6].parse().unwrap(), fields[7].parse().unwrap()))
            .collect()
    }
}
