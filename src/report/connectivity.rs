//! The connectivity check in words: which images share codes, and what is missing.

use std::fmt::Write;

use crate::network::{CODES_TO_CONNECT, Connectivity, ImageConnectivity, ImageId, Network};

/// The table for people: image, codes, images that share a code, images that share enough to connect, codes missing.
#[must_use]
pub fn connectivity_table(network: &Network, connectivity: &Connectivity) -> String {
    let names: Vec<&str> = connectivity
        .images
        .iter()
        .map(|row| path(network, row.image))
        .collect();
    let width = names
        .iter()
        .map(|name| name.chars().count())
        .max()
        .unwrap_or(0)
        .max("image".len());
    let enough = format!("{CODES_TO_CONNECT} or more");
    let mut text = format!(
        "{:<width$}  {:>5}  {:>12}  {enough:>9}  {:>7}\n",
        "image", "codes", "sharing any", "missing"
    );
    for (row, name) in connectivity.images.iter().zip(names) {
        let strong = row.shared.values().filter(|&&n| n >= CODES_TO_CONNECT);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{name:<width$}  {:>5}  {:>12}  {:>9}  {:>7}",
            row.codes.len(),
            row.shared.len(),
            strong.count(),
            row.missing
        );
    }
    text
}

/// What is missing, one sentence each; empty where all images are connected.
#[must_use]
pub fn connectivity_findings(network: &Network, connectivity: &Connectivity) -> Vec<String> {
    let mut findings: Vec<String> = connectivity
        .images
        .iter()
        .filter(|row| row.missing > 0)
        .map(|row| missing_codes(network, connectivity, row))
        .collect();
    // An image that lacks codes is told above; here groups that lack a link between them.
    let groups: Vec<&Vec<ImageId>> = connectivity
        .blocks
        .iter()
        .filter(|block| block.len() > 1)
        .collect();
    if groups.len() > 1 {
        let sizes: Vec<String> = groups.iter().map(|g| g.len().to_string()).collect();
        findings.push(format!(
            "the images fall into {} groups of {} images that share fewer than {CODES_TO_CONNECT} codes: an image that shows codes of both is missing",
            groups.len(),
            sizes.join(" and ")
        ));
    }
    findings
}

fn missing_codes(
    network: &Network,
    connectivity: &Connectivity,
    row: &ImageConnectivity,
) -> String {
    let elsewhere = row
        .codes
        .iter()
        .filter(|code| {
            connectivity
                .images_of_code
                .get(code)
                .is_some_and(|i| i.len() > 1)
        })
        .count();
    let count = match row.codes.len() {
        1 => "1 code".to_owned(),
        n => format!("{n} codes"),
    };
    let seen = match elsewhere {
        n if n == row.codes.len() => String::new(),
        0 => ", none of them in another image".to_owned(),
        n => format!(", {n} of them in other images"),
    };
    format!(
        "{}: {count}{seen}, needs {} more to connect",
        path(network, row.image),
        row.missing
    )
}

fn path(network: &Network, image: ImageId) -> &str {
    network
        .images
        .get(&image)
        .map_or("", |entry| entry.file.path.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{CameraId, ImageEntry, ImageFile};
    use crate::targets::{CodeReading, Detections, Family};
    use std::sync::Arc;

    fn network(codes_of_images: &[&[u32]]) -> Network {
        let images = codes_of_images.iter().zip(1..).map(|(codes, number)| {
            let file = ImageFile {
                path: format!("img_{number}.png"),
                size_bytes: 0,
                sha256: String::new(),
                width_px: 10,
                height_px: 10,
            };
            let mut image = ImageEntry::new(file, CameraId(1));
            let reading = |&id: &u32| CodeReading {
                family: Family::Dot420,
                id,
                dots: Vec::new(),
                misfit: 0.0,
                doubt: None,
            };
            image.detections = Some(Arc::new(Detections {
                codes: codes.iter().map(reading).collect(),
                ..Detections::default()
            }));
            (ImageId(number), Arc::new(image))
        });
        Network {
            images: Arc::new(images.collect()),
            ..Network::default()
        }
    }

    #[test]
    fn what_is_missing_is_said_in_words() {
        let network = network(&[&[1, 2, 3, 4], &[1, 2, 3], &[3, 4], &[4, 9], &[20]]);
        let connectivity = Connectivity::of(&network);
        assert_eq!(
            connectivity_findings(&network, &connectivity),
            [
                "img_3.png: 2 codes, needs 1 more to connect",
                "img_4.png: 2 codes, 1 of them in other images, needs 2 more to connect",
                "img_5.png: 1 code, none of them in another image, needs 3 more to connect",
            ]
        );
        let table = connectivity_table(&network, &connectivity);
        assert_eq!(
            table
                .lines()
                .nth(1)
                .unwrap()
                .split_whitespace()
                .collect::<Vec<_>>(),
            ["img_1.png", "4", "3", "1", "0"]
        );
        assert_eq!(table.lines().count(), 6);
    }

    #[test]
    fn groups_without_a_link_are_told() {
        let network = network(&[&[1, 2, 3], &[1, 2, 3], &[7, 8, 9], &[7, 8, 9]]);
        let findings = connectivity_findings(&network, &Connectivity::of(&network));
        assert_eq!(findings.len(), 1);
        assert!(findings[0].starts_with("the images fall into 2 groups of 2 and 2 images"));
    }
}
