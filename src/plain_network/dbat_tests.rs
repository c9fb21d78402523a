//! The reader on small texts, and the published calibration through our lens.

use nalgebra::Vector2;

use super::super::PlainParameter;
use super::super::fixture::{assert_comes_back, rms};
use super::super::real_data::{data, say, text_of};
use super::*;
use crate::camera::LensDirection;
use crate::camera::{Camera, InteriorOrientation};

const XML: &str = "<document><camera><name>Olympus</name><unit>mm</unit>\n<sensor>auto,6</sensor>\n<image>2400,1600</image>\n<aspect>1</aspect><focal>7.5</focal><model>3</model>\n<nK>2</nK><nP>2</nP><cc>0,0</cc><pp>0,0</pp>\n<!-- <K>9,9,9</K> --><K>1e-3,0,0</K><P>0,0</P><calibration_info><std><K>1,1,1</K></std></calibration_info></camera></document>";
const CONTROL: &str = "# Id,label,X,Y,Z\n1001,CP1,0,1,0\n1002,CP2,1,1,0,0.5\n";

fn read(
    marks: &str,
    camera: &str,
    control: Option<&str>,
    images: Option<&str>,
    stations: Option<&str>,
) -> Result<PlainNetwork, ImportError> {
    let named = |file, text| NamedText { file, text };
    from_dbat(DbatTexts {
        marks: named("marks.txt", marks),
        camera: named("camera.xml", camera),
        control: control.map(|text| named("control.txt", text)),
        images: images.map(|text| named("images.txt", text)),
        stations: stations.map(|text| named("stations.txt", text)),
    })
}

#[test]
fn a_project_is_read() {
    let marks =
        "# image, point, x, y, sxy\n 1, 7, 10.5, 20, 0.1\n 1, 1002, 30, 40\n 2, 7, 5, 6, 0.2\n";
    let images = "1, data/cam/A.JPG\n";
    let stations = "1, 2, 0.5, 1, 2, 0.1, -0.2, 3, 1, 1, B.JPG\n";
    let network = read(marks, XML, Some(CONTROL), Some(images), Some(stations)).unwrap();
    let names: Vec<&str> = network.images.iter().map(|i| i.name.as_str()).collect();
    assert_eq!(names, ["A.JPG", "B.JPG"]);
    assert_eq!(network.images[0].start, None);
    assert!(network.images[1].start.is_some());
    assert_eq!(network.points.len(), 3);
    assert_eq!(network.points[0].known[2].unwrap().sigma_mm, None);
    assert_eq!(network.points[1].known[2].unwrap().sigma_mm, Some(0.5));
    assert_eq!(network.observations[1].point, 1);
    assert_eq!(network.observations[1].sigma_px, DBAT_SIGMA_PX);
    assert_eq!(network.residuals, ResidualPlane::Corrected);
    let camera = &network.cameras[0];
    assert_eq!(camera.lens, LensDirection::CorrectingAffinityFirst);
    assert_eq!(camera.values[..4], [7.5, 0.0, 0.0, 1e-3]);
    assert_eq!(camera.pixel_pitch_mm, 0.00375);
    let free = camera.parameters.map(|p| p == PlainParameter::Free);
    assert_eq!(
        free,
        [true, true, true, true, true, false, true, true, true, false]
    );
}

#[test]
fn angles_beyond_a_turn_are_degrees() {
    let marks = "1, 7, 1, 2, 0.1\n";
    let station = |angles: &str| {
        let stations = format!("1, 1, 0, 0, 2, {angles}\n");
        read(marks, XML, None, None, Some(&stations))
            .unwrap()
            .images[0]
            .start
    };
    let (degrees, radians) = (
        station("10, -5, 90").unwrap(),
        station("0.17453292519943295, -0.08726646259971647, 1.5707963267948966").unwrap(),
    );
    let off = degrees.camera_from_world.matrix() - radians.camera_from_world.matrix();
    assert!(off.amax() < 1e-15);
}

#[test]
fn bad_files_are_answered_in_one_line() {
    let mark = "1, 7, 10.5, 20, 0.1\n";
    let twice = mark.repeat(2);
    let forward = XML.replace("<model>3<", "<model>-1<");
    let open = XML.replace("</focal>", "");
    let no_sensor = XML.replace("auto,6", "auto,auto");
    let two = format!("{XML}{XML}");
    for (marks, xml, control, line) in [
        (
            "1, 7, 10.5\n",
            XML,
            None,
            "marks.txt, line 1: found 3 fields, expected 4 (image, point, x, y)",
        ),
        (
            "1, 7, 10.5, x\n",
            XML,
            None,
            "marks.txt, line 1, column 4 (y): found 'x', expected a number",
        ),
        (
            "1, 7, 1, 1, 0\n",
            XML,
            None,
            "marks.txt, line 1, column 5 (sxy): found '0', expected a number greater than 0",
        ),
        (
            "1, 7, 1, 1, 0.1, 0.2\n",
            XML,
            None,
            "marks.txt, line 1, column 6 (sy): found '0.2', expected the same sigma as in x",
        ),
        (
            &twice,
            XML,
            None,
            "marks.txt, observation 2 of point '7' in image '1': found a second one of it, expected one",
        ),
        (
            mark,
            XML,
            Some("1,a,0,0\n"),
            "control.txt, line 1: found 4 fields, expected 5 (point, label, X, Y, Z)",
        ),
        (
            mark,
            XML,
            Some("1,a,0,0,0,-1\n"),
            "control.txt, line 1, column 6 (sxyz): found '-1', expected 0 or more",
        ),
        (
            mark,
            &forward,
            None,
            "camera.xml, line 4: found <model> '-1', expected 3, which corrects the measured point",
        ),
        (
            mark,
            &open,
            None,
            "camera.xml, line 4: found <focal> without </focal>, expected both",
        ),
        (
            mark,
            &no_sensor,
            None,
            "camera.xml, line 2: found <sensor> 'auto,auto', expected width,height in mm, greater than 0, one of them may be auto",
        ),
        (
            mark,
            &two,
            None,
            "camera.xml, line 6: found <unit> again, expected one camera in the file",
        ),
        (
            mark,
            "",
            None,
            "camera.xml: found no element <unit>, expected it with its text",
        ),
    ] {
        let error = read(marks, xml, control, None, None).unwrap_err();
        assert_eq!(error.to_string(), line);
    }
}

#[test]
fn the_published_calibration_projects_the_control_points_onto_their_marks() {
    let Some(folder) = data("dbat-camcal") else {
        return;
    };
    let text = |file: &str| text_of(&folder, file);
    let network = read(
        &text("markpts.txt"),
        &text("c4040z.xml"),
        Some(&text("camcal-fixed.txt")),
        Some(&text("images.txt")),
        Some(&text("expected_camera_stations.txt")),
    )
    .unwrap();
    assert_eq!(network.images.len(), 21);
    assert_eq!(network.points.len(), 100);
    assert_eq!(network.observations.len(), 2074);
    assert_comes_back(&network);
    assert_eq!(network.images[0].name, "P8250021.JPG");
    let start = &network.cameras[0];
    let half = [start.width_px, start.height_px].map(|n| f64::from(n) / 2.0 * start.pixel_pitch_mm);
    let camera = Camera {
        width_px: start.width_px,
        height_px: start.height_px,
        pixel_pitch_mm: start.pixel_pitch_mm,
        interior: InteriorOrientation {
            principal_distance: 7.457,
            principal_point: [3.61546 - half[0], half[1] - 2.61329],
            radial: [0.00458861, -4.51351e-5, -2.05253e-6],
            tangential: [-6.12803e-5, -4.41172e-5],
            affinity: [0.000389598, 0.0],
            direction: LensDirection::Correcting,
        },
    };
    let ours = control_residuals(&network, &camera, |measured| {
        camera.interior.ideal_from_measured(&measured)
    });
    let theirs = control_residuals(&network, &camera, |measured| {
        let [x0, y0] = camera.interior.principal_point;
        let [aspect, _] = camera.interior.affinity;
        let square = InteriorOrientation {
            principal_point: [0.0; 2],
            affinity: [0.0; 2],
            ..camera.interior
        };
        let scaled = Vector2::new((measured.x - x0) * (1.0 + aspect), measured.y - y0);
        square.ideal_from_measured(&scaled)
    });
    for (name, residuals) in [("our B1", &ours), ("its aspect", &theirs)] {
        say(&format!(
            "dbat-camcal: {} marks of control points, {name}: rms {:.4} px a coordinate, largest {:.4} px, point 1004 {:.4} px",
            residuals.len(),
            rms(&residuals.iter().map(|(_, v)| *v).collect::<Vec<_>>()),
            largest(residuals).1,
            of_point(residuals, "1004"),
        ));
        assert_eq!(residuals.len(), 84);
    }
    // Of its report: the largest residual is at point 1003 on photo 5, the largest rms that of point 1004.
    assert!((largest(&theirs).1 - 0.955).abs() < 0.001);
    assert_eq!(largest(&theirs).0, "1003 in P8250025.JPG");
    assert!((of_point(&theirs, "1004") - 0.553).abs() < 0.001);
    assert!((largest(&ours).1 - 0.955).abs() < 0.01);
}

/// Residuals of the control points' marks in the corrected plane, px, with the names of point and image.
fn control_residuals(
    network: &PlainNetwork,
    camera: &Camera,
    corrected: impl Fn(Vector2<f64>) -> Vector2<f64>,
) -> Vec<(String, Vector2<f64>)> {
    let of = |seen: &PlainObservation| {
        let (image, point) = (&network.images[seen.image], &network.points[seen.point]);
        let at = Vector3::from(point.start.unwrap());
        let k = image.start.unwrap().camera_from_point(&at);
        let computed = Vector2::new(k.x, k.y) * (-camera.interior.principal_distance / k.z);
        let measured = camera.image_from_pixel(&Vector2::new(seen.x_px, seen.y_px));
        let residual = (computed - corrected(measured)) / camera.pixel_pitch_mm;
        (format!("{} in {}", point.name, image.name), residual)
    };
    let control = |seen: &&PlainObservation| network.points[seen.point].role == PointRole::Control;
    network
        .observations
        .iter()
        .filter(control)
        .map(of)
        .collect()
}

fn largest(residuals: &[(String, Vector2<f64>)]) -> (&str, f64) {
    residuals
        .iter()
        .map(|(name, v)| (name.as_str(), v.norm()))
        .fold(("", 0.0), |a, b| if b.1 > a.1 { b } else { a })
}

/// The root of the mean square length of a point's residuals, px.
fn of_point(residuals: &[(String, Vector2<f64>)], point: &str) -> f64 {
    let own = residuals.iter().filter(|(name, _)| name.starts_with(point));
    rms(&own.map(|(_, v)| *v).collect::<Vec<_>>()) * 2f64.sqrt()
}
