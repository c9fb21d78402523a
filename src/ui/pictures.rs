//! Pictures for the window, decoded by a worker: who looks at one asks for it.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::imaging::{GreyImage, LoadSettings, load_picture};
use crate::monitor::Monitor;
use crate::network::{ImageEntry, ImageId};
use crate::project::intake::picture_path;
use crate::worker::{Panicked, Worker};

/// Longer side of a thumbnail, px.
pub const THUMBNAIL_PX: u32 = 96;

/// How much is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureSettings {
    /// Decoded pictures held, in millions of pixels; 2 bytes a pixel. Default 200: eight of 24 megapixels.
    pub megapixels: f64,
}

impl Default for PictureSettings {
    fn default() -> Self {
        Self { megapixels: 200.0 }
    }
}

/// What there is of a picture.
#[derive(Clone, Debug)]
pub enum PictureState {
    /// It is decoded.
    Ready(Arc<GreyImage>),
    /// It is being decoded, or waits for it.
    Loading,
    /// It cannot be read: one line for the operator.
    Missing(String),
}

/// A small copy of a picture, 8 bits, its contrast stretched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Thumbnail {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey values, row by row.
    pub grey: Vec<u8>,
}

impl Thumbnail {
    fn of(picture: &GreyImage) -> Self {
        let longer = picture.width().max(picture.height()).max(1);
        let side =
            |length: usize| (length * THUMBNAIL_PX as usize / longer).clamp(1, length.max(1));
        let (width, height) = (side(picture.width()), side(picture.height()));
        let mut means = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                means.push(mean_of_cell(picture, [column, row], [width, height]));
            }
        }
        let mut sorted = means.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
        let (black, white) = (at(0.01), at(0.995).max(at(0.01) + 1.0));
        let stretched =
            |mean: &f64| ((mean - black) / (white - black) * 255.0).clamp(0.0, 255.0) as u8;
        Self {
            width,
            height,
            grey: means.iter().map(stretched).collect(),
        }
    }

    /// As egui takes pictures.
    #[must_use]
    pub fn to_color_image(&self) -> egui::ColorImage {
        egui::ColorImage::from_gray([self.width, self.height], &self.grey)
    }
}

/// Mean of the pixels of one cell of a grid over the picture, by at most 8 x 8 of them.
fn mean_of_cell(picture: &GreyImage, cell: [usize; 2], cells: [usize; 2]) -> f64 {
    const SAMPLES: usize = 8;
    let bounds = |side: usize, axis: usize| {
        let start = cell[axis] * side / cells[axis];
        start..((cell[axis] + 1) * side / cells[axis]).clamp(start + 1, side.max(1))
    };
    if picture.samples().is_empty() {
        return 0.0;
    }
    let (columns, rows) = (bounds(picture.width(), 0), bounds(picture.height(), 1));
    let (mut sum, mut count) = (0.0, 0.0);
    for row in rows.clone().step_by(rows.len().div_ceil(SAMPLES)) {
        for column in columns.clone().step_by(columns.len().div_ceil(SAMPLES)) {
            sum += f64::from(picture.at(column, row));
            count += 1.0;
        }
    }
    sum / count
}

/// What is wanted of a file. Pictures come before thumbnails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Want {
    Thumbnail,
    Picture,
}

struct Asked {
    path: String,
    first: u64,
    last: u64,
}

struct Decoded {
    generation: u64,
    image: ImageId,
    want: Want,
    path: String,
    result: Result<(Arc<GreyImage>, Arc<Thumbnail>), String>,
}

struct Held {
    path: String,
    picture: Result<Arc<GreyImage>, String>,
}

struct HeldThumbnail {
    path: String,
    /// `None` where the file cannot be read.
    thumbnail: Option<Arc<Thumbnail>>,
}

/// What looking changes: it needs no more than a shared reference.
#[derive(Default)]
struct Looks {
    asked: BTreeMap<(Want, ImageId), Asked>,
    seen: BTreeMap<ImageId, u64>,
}

/// Pictures of the open project.
pub struct PictureStore {
    worker: Worker<Decoded>,
    settings: PictureSettings,
    folder: Option<PathBuf>,
    /// Counts changes of the folder, so that what was decoded for an old one is not taken.
    generation: u64,
    frame: u64,
    under_way: Option<(Want, ImageId, String)>,
    pictures: BTreeMap<ImageId, Held>,
    thumbnails: BTreeMap<ImageId, HeldThumbnail>,
    looks: RefCell<Looks>,
}

/// Frames after which what nobody asked for again is not wanted any more.
const FORGOTTEN_AFTER: u64 = 3;

impl PictureStore {
    /// An empty store; `wake` is called from the worker when a picture is there, and must ask for a frame.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn new(
        settings: PictureSettings,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        Ok(Self {
            worker: Worker::new("pictures", wake)?,
            settings,
            folder: None,
            generation: 0,
            frame: 0,
            under_way: None,
            pictures: BTreeMap::new(),
            thumbnails: BTreeMap::new(),
            looks: RefCell::default(),
        })
    }

    /// The folder that stored paths are relative to; forgets all pictures, the missing ones too.
    pub fn set_folder(&mut self, folder: &Path) {
        self.folder = Some(folder.to_owned());
        self.generation += 1;
        self.pictures.clear();
        self.thumbnails.clear();
        *self.looks.borrow_mut() = Looks::default();
    }

    /// Gives a picture that is in memory already; it is held as if it had been decoded.
    pub fn insert(&mut self, image: ImageId, entry: &ImageEntry, picture: Arc<GreyImage>) {
        let path = entry.file.path.clone();
        let thumbnail = Some(Arc::new(Thumbnail::of(&picture)));
        self.thumbnails.insert(
            image,
            HeldThumbnail {
                path: path.clone(),
                thumbnail,
            },
        );
        self.looks.borrow_mut().seen.insert(image, self.frame);
        self.pictures.insert(
            image,
            Held {
                path,
                picture: Ok(picture),
            },
        );
    }

    /// The picture of an image; asks for it where it is not there.
    pub fn get(&self, image: ImageId, entry: &ImageEntry) -> PictureState {
        let mut looks = self.looks.borrow_mut();
        if let Some(held) = self
            .pictures
            .get(&image)
            .filter(|held| held.path == entry.file.path)
        {
            looks.seen.insert(image, self.frame);
            return match &held.picture {
                Ok(picture) => PictureState::Ready(Arc::clone(picture)),
                Err(reason) => PictureState::Missing(reason.clone()),
            };
        }
        looks.ask(Want::Picture, image, entry, self.frame);
        PictureState::Loading
    }

    /// The thumbnail of an image; asks for it where it is not there.
    pub fn thumbnail(&self, image: ImageId, entry: &ImageEntry) -> Option<Arc<Thumbnail>> {
        if let Some(held) = self
            .thumbnails
            .get(&image)
            .filter(|held| held.path == entry.file.path)
        {
            return held.thumbnail.clone();
        }
        self.looks
            .borrow_mut()
            .ask(Want::Thumbnail, image, entry, self.frame);
        None
    }

    /// Takes what is decoded and gives the worker the next file; once a frame, before panels look.
    pub fn poll(&mut self) {
        self.frame += 1;
        while let Some(result) = self.worker.poll() {
            let order = self.under_way.take();
            match (result, order) {
                (Ok(decoded), _) => self.take(decoded),
                (Err(panicked), Some(order)) => self.take_panic(&panicked, order),
                (Err(_), None) => {}
            }
        }
        self.drop_long_unseen();
        if !self.worker.is_busy() {
            self.start_next();
        }
    }

    /// Whether a file is being decoded.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.worker.is_busy()
    }

    fn take(&mut self, decoded: Decoded) {
        let Decoded {
            generation,
            image,
            want,
            path,
            result,
        } = decoded;
        if generation != self.generation {
            return;
        }
        let mut looks = self.looks.borrow_mut();
        looks.asked.remove(&(want, image));
        let thumbnail = result
            .as_ref()
            .ok()
            .map(|(_, thumbnail)| Arc::clone(thumbnail));
        self.thumbnails.insert(
            image,
            HeldThumbnail {
                path: path.clone(),
                thumbnail,
            },
        );
        // A picture that was decoded for its thumbnail alone is let go: the memory is for those that are looked at.
        if want == Want::Picture || result.is_err() {
            looks.seen.insert(image, self.frame);
            let picture = result.map(|(picture, _)| picture);
            self.pictures.insert(image, Held { path, picture });
        }
    }

    fn take_panic(&mut self, panicked: &Panicked, (want, image, path): (Want, ImageId, String)) {
        let result = Err(format!("{path}: {panicked}"));
        self.take(Decoded {
            generation: self.generation,
            image,
            want,
            path,
            result,
        });
    }

    fn start_next(&mut self) {
        let Some(folder) = self.folder.clone() else {
            return;
        };
        let mut looks = self.looks.borrow_mut();
        let frame = self.frame;
        looks
            .asked
            .retain(|_, asked| asked.last + FORGOTTEN_AFTER >= frame);
        let next = looks
            .asked
            .iter()
            .max_by_key(|((want, image), asked)| (*want, asked.first, std::cmp::Reverse(*image)));
        let Some((&(want, image), asked)) = next else {
            return;
        };
        let (path, generation) = (asked.path.clone(), self.generation);
        self.under_way = Some((want, image, path.clone()));
        self.worker.start(Arc::new(Monitor::new()), move |_| {
            let file = picture_path(&folder, &path);
            let result = load_picture(&file, &LoadSettings::default())
                .map(|picture| {
                    let thumbnail = Thumbnail::of(&picture.image);
                    (Arc::new(picture.image), Arc::new(thumbnail))
                })
                .map_err(|error| error.to_string());
            Decoded {
                generation,
                image,
                want,
                path,
                result,
            }
        });
    }

    /// Lets the pictures go that were not looked at for longest, until the others fit; what is on screen stays.
    fn drop_long_unseen(&mut self) {
        let mut looks = self.looks.borrow_mut();
        loop {
            let pixels = |held: &Held| held.picture.as_ref().map_or(0, |p| p.samples().len());
            let held: usize = self.pictures.values().map(pixels).sum();
            if held as f64 <= self.settings.megapixels * 1e6 {
                return;
            }
            let seen = |image: &ImageId| looks.seen.get(image).copied().unwrap_or(0);
            let oldest = self
                .pictures
                .iter()
                .filter(|(_, held)| pixels(held) > 0)
                .map(|(image, _)| *image);
            let Some(oldest) = oldest.min_by_key(|image| (seen(image), *image)) else {
                return;
            };
            if seen(&oldest) + FORGOTTEN_AFTER >= self.frame {
                return;
            }
            self.pictures.remove(&oldest);
            looks.seen.remove(&oldest);
        }
    }
}

impl Looks {
    fn ask(&mut self, want: Want, image: ImageId, entry: &ImageEntry, frame: u64) {
        let path = &entry.file.path;
        let asked = self.asked.entry((want, image)).or_insert_with(|| Asked {
            path: path.clone(),
            first: frame,
            last: frame,
        });
        asked.last = frame;
        if asked.path != *path {
            asked.path.clone_from(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::BitDepth;
    use crate::network::{CameraId, ImageFile};
    use std::sync::mpsc::channel;

    fn entry(path: &str) -> ImageEntry {
        let file = ImageFile {
            path: path.into(),
            size_bytes: 0,
            sha256: String::new(),
            width_px: 4,
            height_px: 3,
        };
        ImageEntry::new(file, CameraId(1))
    }

    fn write(folder: &Path, name: &str, grey: u8) {
        let mut bytes = b"P5\n4 3\n255\n".to_vec();
        bytes.extend([grey; 12]);
        std::fs::write(folder.join(name), bytes).unwrap();
    }

    fn folder(name: &str) -> PathBuf {
        let folder =
            std::env::temp_dir().join(format!("tiepoint-pictures-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn looking_asks_and_a_missing_file_says_so() {
        let folder = folder("looking");
        write(&folder, "a.pgm", 7);
        let (wake, woken) = channel();
        let mut store = PictureStore::new(PictureSettings::default(), move || {
            wake.send(()).unwrap_or(());
        })
        .unwrap();
        store.set_folder(&folder);
        let (a, b) = (entry("a.pgm"), entry("b.pgm"));
        for _ in 0..2 {
            assert!(matches!(
                store.get(ImageId(1), &a),
                PictureState::Loading | PictureState::Ready(_)
            ));
            store.get(ImageId(2), &b);
            store.poll();
            woken.recv().unwrap();
            store.get(ImageId(1), &a);
            store.get(ImageId(2), &b);
            store.poll();
        }
        let PictureState::Ready(picture) = store.get(ImageId(1), &a) else {
            panic!("not decoded");
        };
        assert_eq!(picture.at(0, 0), 7.0);
        let PictureState::Missing(reason) = store.get(ImageId(2), &b) else {
            panic!("there is no such file");
        };
        assert!(reason.contains("b.pgm"), "{reason}");
        assert!(
            store.thumbnail(ImageId(1), &a).is_some(),
            "a decoded picture has its thumbnail"
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn pictures_out_of_sight_make_room() {
        let settings = PictureSettings { megapixels: 0.002 };
        let mut store = PictureStore::new(settings, || {}).unwrap();
        let picture = || Arc::new(GreyImage::new(40, 30, BitDepth::Eight, vec![0; 1200]).unwrap());
        let (a, b) = (entry("a"), entry("b"));
        store.insert(ImageId(1), &a, picture());
        store.insert(ImageId(2), &b, picture());
        for _ in 0..6 {
            store.poll();
            assert!(matches!(store.get(ImageId(2), &b), PictureState::Ready(_)));
        }
        assert!(matches!(store.get(ImageId(1), &a), PictureState::Loading));
    }

    #[test]
    fn a_thumbnail_keeps_the_shape_and_stretches_the_contrast() {
        let samples = (0..400 * 200)
            .map(|slot| 100 + (slot % 400 / 10) as u16)
            .collect();
        let thumbnail = Thumbnail::of(&GreyImage::new(400, 200, BitDepth::Eight, samples).unwrap());
        assert_eq!((thumbnail.width, thumbnail.height), (96, 48));
        assert!(thumbnail.grey[0] < 10 && thumbnail.grey[95] > 245);
    }
}
