//! What is written is read back to the bit; what is wrong is named.

use proptest::prelude::*;

use super::super::fixture::{random_network, small_network};
use super::*;

fn read(text: &str) -> Result<PlainNetwork, ImportError> {
    from_json(NamedText {
        file: "net.json",
        text,
    })
}

const HEAD: &str = r#""format":"tiepoint-network","version":1"#;
const CAMERA: &str =
    r#"{"name":"A","width_px":4000,"height_px":3000,"pixel_pitch_mm":0.005,"values":{"c":24}}"#;

/// A file with these texts in the place of its lists.
fn file(images: &str, points: &str, observations: &str, rest: &str) -> String {
    format!(
        "{{{HEAD},\"cameras\":[{CAMERA}],\"images\":[{images}],\"points\":[{points}],\"observations\":[{observations}]{rest}}}"
    )
}

proptest! {
    #[test]
    fn a_network_comes_back_to_the_bit(seed in 0u64..1000) {
        let network = random_network(seed);
        let text = to_json(&network).unwrap();
        let back = read(&text).unwrap();
        prop_assert_eq!(&back, &network);
        // Equal texts: -0 and 0 are equal numbers but differ in their bits.
        prop_assert_eq!(to_json(&back).unwrap(), text);
    }

    #[test]
    fn a_damaged_file_is_answered_and_never_a_panic(at in 0usize..3000, byte in 32u8..127) {
        let mut text = to_json(&small_network()).unwrap().into_bytes();
        let at = at % text.len();
        text[at] = byte;
        if let Err(error) = read(std::str::from_utf8(&text).unwrap()) {
            prop_assert!(!error.to_string().contains('\n'), "{error}");
        }
    }
}

#[test]
fn a_line_break_in_a_word_stays_in_one_line() {
    let text = to_json(&small_network()).unwrap();
    let broken = text.replace("\"role\":\"control\"", "\"role\":\"c\\ntrol\"");
    assert_ne!(broken, text);
    let error = read(&broken).unwrap_err().to_string();
    assert!(error.contains("'c?trol'"), "{error}");
}

#[test]
fn what_is_left_out_has_its_default() {
    let text = file(
        r#"{"name":"1"},{"name":"2","camera":"A"}"#,
        r#"{"name":"p"},{"name":"q","known":[{"value_mm":1.5},null,{"value_mm":2,"sigma_mm":0.1}]}"#,
        r#"["1","p",10,20],["2","p",11,21,0.5]"#,
        r#","sigma_px":0.1,"distances":[{"name":"d","from":"p","to":"q","length_mm":5,"sigma_mm":0.01}]"#,
    );
    let network = read(&text).unwrap();
    assert_eq!(network.images[0].camera, 0);
    assert_eq!(network.images[0].start, None);
    assert_eq!(network.points[0].role, PointRole::New);
    assert_eq!(network.points[1].role, PointRole::Control);
    assert_eq!(
        network.points[1].known[0].map(|known| known.sigma_mm),
        Some(None)
    );
    assert_eq!(network.datum, PlainDatum::Control);
    assert_eq!(network.observations[0].sigma_px, 0.1);
    assert_eq!(network.observations[1].sigma_px, 0.5);
    assert_eq!(network.cameras[0].parameters, [PlainParameter::Fixed; 10]);
    assert_eq!(network.cameras[0].values[1..], [0.0; 9]);
}

#[test]
fn a_warm_bar_is_calibrated_at_twenty_degrees_where_nothing_is_said() {
    let text = file(
        r#"{"name":"1"}"#,
        r#"{"name":"p"},{"name":"q"}"#,
        "",
        r#","distances":[{"name":"d","from":"p","to":"q","length_mm":1000,"sigma_mm":0.01,"temperature_c":30,"expansion_per_k":11.5e-6}],
        "object":{"temperature_c":25,"reference_c":15,"expansion_per_k":23e-6}"#,
    );
    let network = read(&text).unwrap();
    let length = network.length_mm(&network.distances[0]);
    assert!((length - 1000.115 / 1.00023).abs() < 1e-9, "{length}");
}

#[test]
fn a_sigma_that_is_no_number_does_not_fix_a_coordinate() {
    let points = |sigma: &str| {
        let known = format!(r#"{{"value_mm":1.5,"sigma_mm":{sigma}}}"#);
        format!(r#"{{"name":"p","known":[{known},null,null]}}"#)
    };
    let with = |sigma: &str| {
        let text = file(
            r#"{"name":"1"}"#,
            &points(sigma),
            r#"["1","p",10,20]"#,
            r#","sigma_px":0.1"#,
        );
        read(&text)
    };
    assert!(with("0.5").is_ok());
    for no_number in ["NaN", "Infinity", "-Infinity"] {
        let error = with(no_number).unwrap_err().to_string();
        assert!(error.contains("line "), "{error}");
    }
}

#[test]
fn image_points_that_an_adjustment_leaves_out_are_read() {
    let text = file(
        r#"{"name":"1"},{"name":"NaN \" NaN"}"#,
        r#"{"name":"p"}"#,
        r#"["1","p",NaN,20],["1","p",null,-Infinity],["NaN \" NaN","p",1,2,NaN]"#,
        r#","sigma_px":0.1"#,
    );
    let network = read(&text).unwrap();
    assert_eq!(network.images[1].name, "NaN \" NaN");
    let numbers = network.observations.iter();
    let numbers: Vec<[bool; 3]> = numbers
        .map(|o| [o.x_px, o.y_px, o.sigma_px].map(f64::is_finite))
        .collect();
    let [yes, no] = [true, false];
    assert_eq!(numbers, [[no, yes, yes], [no, no, yes], [yes, yes, no]]);
}

#[test]
fn the_documented_file_is_read() {
    let text: Vec<&str> = include_str!("json.rs")
        .lines()
        .skip_while(|line| !line.contains("```json"))
        .skip(1)
        .take_while(|line| !line.contains("```"))
        .map(|line| line.trim_start_matches("///"))
        .collect();
    let network = read(&text.join("\n")).unwrap();
    assert_eq!(network.observations[1].sigma_px, 0.2);
    assert_eq!(network.points[2].role, PointRole::Check);
    let sharing = |k: usize| network.cameras[0].sharing[k];
    assert_eq!(
        [0, 1, 2].map(sharing),
        [Sharing::Camera, Sharing::Image, Sharing::Image]
    );
}

#[test]
fn bad_files_are_answered_in_one_line() {
    let image = r#"{"name":"1"}"#;
    let point = r#"{"name":"p"}"#;
    let seen = r#"["1","p",10,20,0.1]"#;
    let warm = |keys: &str| {
        let points = format!(r#"{point},{{"name":"q"}}"#);
        let bar = r#"{"name":"d","from":"p","to":"q","length_mm":5,"sigma_mm":0.1"#;
        file(
            image,
            &points,
            seen,
            &format!(r#","distances":[{bar},{keys}}}]"#),
        )
    };
    let cases = [
        (
            "{\n\"format\": \"tiepoint-network\",\n}".to_owned(),
            "net.json, line 3, column 1: found '}', expected JSON (trailing comma)",
        ),
        (
            String::new(),
            "net.json, line 1, column 1: found the end of the text, expected JSON (EOF while parsing a value)",
        ),
        (
            r#"{"format":"tiepoint-network","version":2,"cameras":[],"images":[],"points":[],"observations":[]}"#.to_owned(),
            "net.json, version: found 2, expected 1",
        ),
        (
            r#"{"format":"geojson","version":1,"cameras":[],"images":[],"points":[],"observations":[]}"#.to_owned(),
            "net.json, format: found 'geojson', expected tiepoint-network",
        ),
        (
            file(image, point, seen, ",\"colour\":1"),
            "net.json, line 1, column 233: found the key 'colour', expected one of format, version, residuals, sigma_px, datum, cameras, images, points, observations, distances, object",
        ),
        (
            file(image, point, r#"["1","p",10]"#, ""),
            "net.json, line 1, column 216: found a list of 3, expected [image, point, x_px, y_px] with or without sigma_px as a fifth",
        ),
        (
            file(image, point, r#"["1","p",1e999,20]"#, ""),
            "net.json, line 1, column 218: found '9,20]]}', expected JSON (number out of range)",
        ),
        (
            file(image, r#"{"name":"p","start_mm":[NaN,0,0]}"#, "", ""),
            "net.json, line 1, column 199: found 'NaN,0,0]}],\"observations\":[]}', expected JSON (expected value)",
        ),
        (
            file(r#"{"name":"1","camera":"B"}"#, point, "", ""),
            "net.json, image '1': found the camera 'B', expected the name of one that is listed",
        ),
        (
            file(image, point, r#"["2","p",10,20]"#, ""),
            "net.json, observation 1 of point 'p' in image '2': found the image '2', expected the name of one that is listed",
        ),
        (
            file(image, point, r#"["1","q",10,20]"#, ""),
            "net.json, observation 1 of point 'q' in image '1': found the point 'q', expected the name of one that is listed",
        ),
        (
            file(image, point, r#"["1","p",10,20]"#, ""),
            "net.json, observation 1 of point 'p' in image '1': found no sigma, expected sigma_px as its fifth number, or one for all in the file",
        ),
        (
            file(image, &format!("{point},{point}"), seen, ""),
            "net.json, point 'p': found a second one of this name, expected one",
        ),
        (
            file(image, point, seen, r#","distances":[{"name":"d","from":"p","to":"q","length_mm":5,"sigma_mm":1}]"#),
            "net.json, distance 'd': found the point 'q', expected the name of one that is listed",
        ),
        (
            warm(r#""temperature_c":30"#),
            "net.json, distance 'd': found temperature_c alone, expected expansion_per_k with it",
        ),
        (
            warm(r#""calibrated_at_c":23"#),
            "net.json, distance 'd': found calibrated_at_c alone, expected temperature_c and expansion_per_k with it",
        ),
        (
            warm(r#""temperature_c":-274,"expansion_per_k":1e-5"#),
            "net.json, distance 'd': found temperature_c -274, expected a number from -273.15 to 1000",
        ),
        (
            file(image, point, seen, r#","object":{"temperature_c":30,"expansion_per_k":23}"#),
            "net.json, object: found expansion_per_k 23, expected a number from -0.0005 to 0.0005",
        ),
        (
            file(image, point, seen, r#","object":{"temperature_c":30}"#),
            "net.json, line 1, column 254: found no key expansion_per_k, expected it",
        ),
        (
            file(image, point, seen, r#","datum":{"inner_constraints":["q"]}"#),
            "net.json, datum: found the point 'q', expected the name of one that is listed",
        ),
        (
            file(image, point, seen, r#","datum":{"inner_constraints":"some"}"#),
            "net.json, line 1, column 260: found string \"some\", expected \"all\" or a list of names of points",
        ),
        (
            file(r#"{"name":"1","centre_mm":[1,2,3]}"#, point, seen, ""),
            "net.json, image '1': found centre_mm alone, expected camera_from_world with it",
        ),
        (
            file(image, point, seen, "").replace(r#""values""#, r#""free":["K9"],"values""#),
            "net.json, camera 'A': found the parameter 'K9', expected one of c, x0, y0, K1, K2, K3, P1, P2, B1, B2",
        ),
        (
            file(image, point, seen, "").replace(r#""values""#, r#""free":["K1"],"weighted":{"K1":1e-6},"values""#),
            "net.json, camera 'A': found the parameter K1 again, expected it once",
        ),
        (
            file(image, point, seen, "").replace(r#""values""#, r#""free":["K1"],"per_image":["K1","K1"],"values""#),
            "net.json, camera 'A': found the parameter K1 again, expected it once",
        ),
        (
            file(image, point, seen, "").replace(r#""values""#, r#""free":["K1"],"per_image":["c"],"values""#),
            "net.json, camera 'A': found c for each image but fixed, expected it free or weighted",
        ),
        (
            file(image, point, seen, ",\"version\":1"),
            "net.json, line 1, column 234: found the key version again, expected it once",
        ),
        (
            file(image, point, r#"["1","p",10,20,0.1,0.1]"#, ""),
            "net.json, line 1, column 227: found a list of 6, expected [image, point, x_px, y_px] with or without sigma_px as a fifth",
        ),
        (
            file(image, point, seen, "").replace(r#"{"c":24}"#, "{}"),
            "net.json, line 1, column 131: found no key c, expected it",
        ),
    ];
    for (text, line) in cases {
        let error = read(&text).expect_err(&text);
        assert_eq!(error.to_string(), line, "{text}");
    }
}
