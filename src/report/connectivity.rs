//! The connectivity check in words: which images share codes, and what is missing.

use std::fmt::Write;

use crate::network::{CODES_TO_CONNECT, Connectivity, ImageId, Network};

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
    use crate::targets::{CodeEvidence, CodeReading, Detections, Family};
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
                evidence: CodeEvidence::default(),
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
    fn the_table_counts_codes_and_links() {
        let network = network(&[&[1, 2, 3, 4], &[1, 2, 3], &[3, 4], &[4, 9], &[20]]);
        let table = connectivity_table(&network, &Connectivity::of(&network));
        let rows: Vec<Vec<&str>> = table
            .lines()
            .map(|line| line.split_whitespace().collect())
            .collect();
        assert_eq!(rows.len(), 6);
        assert_eq!(rows[1], ["img_1.png", "4", "3", "1", "0"]);
        assert_eq!(rows[5], ["img_5.png", "1", "0", "0", "3"]);
    }
}
