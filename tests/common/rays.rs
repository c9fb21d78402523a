//! Networks of rays without pictures, as their JSON files.

use serde_json::{Value, json};

/// Where the images are taken, mm: all look straight down at points round the origin.
pub const CENTRES: [[f64; 3]; 6] = [
    [-400.0, 0.0, 1000.0],
    [0.0, 350.0, 1000.0],
    [400.0, -50.0, 1050.0],
    [50.0, -380.0, 950.0],
    [-250.0, 260.0, 1100.0],
    [270.0, 240.0, 900.0],
];

/// Twelve points on three levels, mm.
pub fn places() -> Vec<[f64; 3]> {
    (0..12)
        .map(|k| {
            [
                f64::from(k % 4) * 80.0 - 120.0,
                f64::from(k / 4) * 100.0 - 100.0,
                f64::from(k % 3) * 40.0,
            ]
        })
        .collect()
}

/// Images `I0`, ... of one camera with c = 20 mm that see all points `P0`, ..., without noise; the distance `bar` from P0 to P3.
pub fn network_of_rays(places: &[[f64; 3]], centres: &[[f64; 3]]) -> Value {
    let name = |kind: &str, k: usize| format!("{kind}{k}");
    let mut seen = Vec::new();
    for (image, centre) in centres.iter().enumerate() {
        for (point, place) in places.iter().enumerate() {
            // The camera looks along -z; pixels of 5 um.
            let away = std::array::from_fn::<f64, 3, _>(|axis| place[axis] - centre[axis]);
            let scale = -20.0 / away[2] / 0.005;
            seen.push(json!([
                name("I", image),
                name("P", point),
                2000.0 + scale * away[0],
                1500.0 - scale * away[1]
            ]));
        }
    }
    let images = centres.iter().enumerate().map(|(k, centre)| {
        json!({
            "name": name("I", k), "camera": "A", "centre_mm": centre,
            "camera_from_world": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        })
    });
    let points = (0..places.len()).map(|k| json!({"name": name("P", k)}));
    let from_first = |axis: usize| places[3][axis] - places[0][axis];
    let length = (0..3)
        .map(|axis| from_first(axis).powi(2))
        .sum::<f64>()
        .sqrt();
    json!({
        "format": "tiepoint-network", "version": 1, "sigma_px": 0.1,
        "cameras": [{"name": "A", "width_px": 4000, "height_px": 3000, "pixel_pitch_mm": 0.005, "values": {"c": 20}}],
        "images": images.collect::<Vec<_>>(),
        "points": points.collect::<Vec<_>>(),
        "observations": seen,
        "distances": [{"name": "bar", "from": "P0", "to": "P3", "length_mm": length, "sigma_mm": 0.01}],
    })
}
