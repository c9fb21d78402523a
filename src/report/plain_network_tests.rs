//! What is told of networks without pictures.

use nalgebra::Vector3;

use super::*;
use crate::geometry::Pose;
use crate::monitor::Monitor;
use crate::plain_network::{
    DatumPoints, NamedText, PlainDatum, PlainImage, PlainObservation, PlainPoint, PlainSettings,
    from_json, to_json,
};

/// Six images of twenty points on two levels, without noise; each image has x0 and y0 for itself.
fn network() -> PlainNetwork {
    let camera = r#"{"name":"A","width_px":4000,"height_px":3000,"pixel_pitch_mm":0.005,"values":{"c":24},
        "free":["c"],"weighted":{"x0":0.05,"y0":0.05},"per_image":["x0","y0"]}"#;
    let text = format!(
        r#"{{"format":"tiepoint-network","version":1,"cameras":[{camera}],"images":[],"points":[],"observations":[]}}"#
    );
    let named = |text| NamedText { file: "net", text };
    let mut network = from_json(named(&text)).unwrap();
    network.datum = PlainDatum::InnerConstraints(DatumPoints::All);
    let place = |k: usize| {
        let [x, y, z] = [k % 5, k / 5, k % 3].map(|n| n as f64);
        Vector3::new(100.0 * x - 200.0, 110.0 * y - 165.0, 60.0 * z)
    };
    for k in 0..20 {
        let start = Some(place(k).into());
        network.points.push(PlainPoint::new(format!("P{k}"), start));
    }
    for image in 0..6 {
        let around = std::f64::consts::TAU * image as f64 / 6.0;
        let from = Vector3::new(600.0 * around.cos(), 600.0 * around.sin(), 900.0);
        let roll = 1.6 * image as f64;
        let pose = Pose::looking_at(from, Vector3::zeros(), Vector3::y(), roll);
        network.images.push(PlainImage {
            name: format!("I{image}"),
            camera: 0,
            start: Some(pose),
        });
        for point in 0..20 {
            let in_camera = pose.camera_from_point(&place(point));
            let pixel = network.cameras[0].camera().project(&in_camera).unwrap();
            network.observations.push(PlainObservation {
                image,
                point,
                x_px: pixel.x,
                y_px: pixel.y,
                sigma_px: 0.1,
            });
        }
    }
    let text = to_json(&network).unwrap();
    from_json(named(&text)).unwrap()
}

#[test]
fn what_each_image_has_for_itself_stands_with_the_image() {
    let network = network();
    let adjusted = network.adjust(&PlainSettings::default(), &Monitor::new());
    let report = PlainReport::new(&network, &adjusted.unwrap());
    let states: Vec<&str> = report.cameras[0]
        .parameters
        .iter()
        .map(|p| p.state)
        .collect();
    assert_eq!(states[..4], ["free", PER_IMAGE, PER_IMAGE, "fixed"]);
    for image in &report.images {
        let [x0, y0] = &image.parameters[..] else {
            panic!("{:?}", image.parameters);
        };
        assert_eq!([x0.name, y0.name], ["x0", "y0"]);
        for row in [x0, y0] {
            assert_eq!(row.state, "weighted");
            assert!(row.value.abs() < 1e-6);
        }
    }
    let text = report.text();
    assert!(text.contains("\n  x0  per image\n"), "{text}");
    let lines = text.lines().filter(|line| line.starts_with("image 'I"));
    assert_eq!(lines.filter(|line| line.contains("  y0 ")).count(), 6);
}
