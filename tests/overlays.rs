//! `detect --overlay`: pictures with what was found in them, as the program writes them.

mod common;

use std::fs;

use common::{Folder, HEIGHT_PX, WIDTH_PX, pixels, scene};

#[test]
fn overlays_show_what_was_found_in_pictures_of_the_same_size() {
    let folder = Folder::with_inputs("overlay");
    folder.add_picture(0);
    let path = format!("images/{}", scene().pictures[0].0);
    fs::create_dir(folder.at("again")).unwrap();
    fs::copy(folder.at(&path), folder.at("again/img.png")).unwrap();
    fs::copy(folder.at(&path), folder.at("img.png")).unwrap();
    let arguments = [
        "detect",
        "img.png",
        &path,
        "again/img.png",
        "--json",
        "--overlay",
        "new/shown",
    ];
    let reports = folder.run(&arguments).json();
    let mut names: Vec<String> = fs::read_dir(folder.at("new/shown"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let stem = path.trim_start_matches("images/").trim_end_matches(".png");
    let own = format!("{stem}-overlay.png");
    assert_eq!(
        names,
        [own.as_str(), "img-2-overlay.png", "img-overlay.png"]
    );

    let plain = pixels(0);
    let drawn = image::open(folder.at("new/shown/img-overlay.png")).unwrap();
    assert_eq!([drawn.width(), drawn.height()], [WIDTH_PX, HEIGHT_PX]);
    let drawn = drawn.into_rgb8();
    let is_grey = |x: f64, y: f64| {
        let [red, green, blue] = drawn.get_pixel(x as u32, y as u32).0;
        red == green && green == blue
    };
    // Brightening keeps black black.
    assert!(
        plain
            .pixels()
            .zip(drawn.pixels())
            .any(|(a, b)| b.0 == [0; 3] && a.0[0] < 30)
    );
    for target in reports[0]["targets"].as_array().unwrap() {
        let number = |key: &str| target[key].as_f64().unwrap();
        let (x, y) = (number("x_px"), number("y_px"));
        let (sin, cos) = number("angle_deg").to_radians().sin_cos();
        let half = 0.5 * number("major_px");
        // Each end of the larger diameter lies on the ellipse.
        for side in [-half, half] {
            assert!(!is_grey(x + side * cos, y + side * sin), "{target}");
        }
    }

    let single = folder.run(&["detect", &path, "--overlay", "new/shown"]);
    assert!(single.done().contains(" targets, "), "{single:?}");
    folder
        .run(&["detect", &path, "--overlay", "camera.toml"])
        .refused(2, &["camera.toml", "found a file", "expected a folder"]);
    folder
        .run(&["detect", &path, "--overlay", "camera.toml/below"])
        .refused(2, &["camera.toml/below", "cannot be made"]);
}

/// A picture that is looked at is not written over, even where its name asks for it.
#[test]
fn an_overlay_never_replaces_a_picture() {
    let folder = Folder::with_inputs("overlay-own");
    folder.add_picture(0);
    let path = format!("images/{}", scene().pictures[0].0);
    for name in ["a.png", "a-overlay.png"] {
        fs::copy(folder.at(&path), folder.at(name)).unwrap();
    }
    let arguments = ["detect", "a.png", "a-overlay.png", "--overlay", "."];
    folder.run(&arguments).done();
    assert_eq!(folder.read("a-overlay.png"), folder.read(&path));
    for name in ["a-2-overlay.png", "a-overlay-overlay.png"] {
        assert!(folder.names().contains(&name.to_owned()), "{name}");
    }
}
