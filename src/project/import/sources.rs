//! Which files of a folder are a program's network, and what they hold.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::{ImportingError, Program};
use crate::plain_network::{
    AiconTexts, ColmapTexts, DbatTexts, NamedText, PlainNetwork, from_aicon, from_colmap, from_dbat,
};
use crate::project::files::read_text;

/// A network as it was read.
#[derive(Clone, Debug)]
pub(super) struct Source {
    /// The network.
    pub(super) network: PlainNetwork,
    /// What the operator should know of the files, one line each.
    pub(super) told: Vec<String>,
}

/// A file with its text.
struct Text {
    file: String,
    text: String,
}

impl Text {
    fn read(path: &Path) -> Result<Self, ImportingError> {
        Ok(Self {
            file: path.display().to_string(),
            text: read_text(path)?,
        })
    }

    fn named(&self) -> NamedText<'_> {
        NamedText {
            file: &self.file,
            text: &self.text,
        }
    }
}

/// Reads the network of a folder.
///
/// # Errors
/// [`ImportingError`]: no such folder, a file is missing or there twice, or one is bad.
pub(super) fn read(program: Program, folder: &Path) -> Result<Source, ImportingError> {
    let files = files_of(folder)?;
    match program {
        Program::Aicon => aicon(folder, &files),
        Program::Dbat => dbat(folder, &files),
        Program::Colmap => colmap(folder),
    }
}

/// The files of a folder, sorted.
fn files_of(folder: &Path) -> Result<Vec<PathBuf>, ImportingError> {
    let refused = |error: io::Error| {
        let found = match error.kind() {
            io::ErrorKind::NotFound => "no such folder".to_owned(),
            io::ErrorKind::NotADirectory => "a file".to_owned(),
            _ => error.to_string(),
        };
        unexpected(folder, found, "the folder of another program's files")
    };
    let entries: Vec<fs::DirEntry> = fs::read_dir(folder)
        .and_then(Iterator::collect)
        .map_err(refused)?;
    let paths = entries.into_iter().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = paths.filter(|path| path.is_file()).collect();
    files.sort();
    Ok(files)
}

fn unexpected(
    folder: &Path,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> ImportingError {
    ImportingError::Folder {
        folder: folder.to_owned(),
        found: found.into(),
        expected: expected.into(),
    }
}

/// The files of an ending.
fn ending<'a>(files: &'a [PathBuf], ending: &str) -> Vec<&'a PathBuf> {
    let has_it = |path: &&PathBuf| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case(ending))
    };
    files.iter().filter(has_it).collect()
}

/// Names of files, as a message lists them.
fn listed(files: &[&PathBuf]) -> String {
    let name = |path: &&PathBuf| {
        path.file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    files.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// The only one of these files; `None` where there is none.
fn only<'a>(
    folder: &Path,
    what: &str,
    files: &[&'a PathBuf],
) -> Result<Option<&'a PathBuf>, ImportingError> {
    match files {
        [] => Ok(None),
        [file] => Ok(Some(file)),
        several => {
            let found = format!("{} {what} ({})", several.len(), listed(several));
            Err(unexpected(folder, found, "one of them"))
        }
    }
}

fn aicon(folder: &Path, files: &[PathBuf]) -> Result<Source, ImportingError> {
    const BUNDLE: &str = "an AICON bundle: .ior, .eor, .obc, .phc and, with bars, .scale";
    let optional = |kind: &str| {
        let file = only(folder, &format!("files .{kind}"), &ending(files, kind))?;
        file.map(|path| Text::read(path)).transpose()
    };
    let required = |kind: &str| {
        let none = || unexpected(folder, format!("no file .{kind}"), BUNDLE);
        optional(kind)?.ok_or_else(none)
    };
    let (cameras, orientations) = (required("ior")?, required("eor")?);
    let (points, image_points) = (required("obc")?, required("phc")?);
    let bars = optional("scale")?;
    let network = from_aicon(AiconTexts {
        cameras: cameras.named(),
        orientations: orientations.named(),
        points: points.named(),
        image_points: image_points.named(),
        bars: bars.as_ref().map(Text::named),
    })?;
    Ok(Source {
        network,
        told: Vec::new(),
    })
}

/// What a table of DBAT holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Table {
    Marks,
    Control,
    Images,
    Stations,
}

impl Table {
    /// What the fields of a text's first row and its ids say; `None` where it is none of the tables. Names of the files are
    /// free: images are listed with a path, stations with nine fields or more, and of the others the marked points repeat the
    /// number of their image, while every control point stands once.
    fn of(text: &str) -> Option<Self> {
        let rows = text.lines().map(str::trim);
        let mut rows = rows
            .filter(|row| !row.is_empty() && !row.starts_with('#'))
            .peekable();
        let fields = rows.peek()?.split(',').count();
        let mut ids: Vec<&str> = rows.filter_map(|row| row.split(',').next()).collect();
        let all = ids.len();
        ids.sort_unstable();
        ids.dedup();
        match fields {
            2 => Some(Table::Images),
            4 => Some(Table::Marks),
            5 | 6 if ids.len() < all => Some(Table::Marks),
            5..=8 => Some(Table::Control),
            9.. => Some(Table::Stations),
            _ => None,
        }
    }
}

fn dbat(folder: &Path, files: &[PathBuf]) -> Result<Source, ImportingError> {
    const PROJECT: &str =
        "a camera (.xml) and a table of marked points (image, point, x, y[, sigma]) of DBAT";
    let camera = only(folder, "files .xml", &ending(files, "xml"))?;
    let camera = camera.ok_or_else(|| unexpected(folder, "no file .xml", PROJECT))?;
    let camera = Text::read(camera)?;
    let mut tables = Vec::new();
    for path in ending(files, "txt").into_iter().chain(ending(files, "csv")) {
        let text = Text::read(path)?;
        if let Some(table) = Table::of(&text.text) {
            tables.push((table, path, text));
        }
    }
    let of = |wanted: Table| tables.iter().filter(move |(table, ..)| *table == wanted);
    let paths = |wanted: Table| of(wanted).map(|(_, path, _)| *path).collect::<Vec<_>>();
    only(folder, "tables of marked points", &paths(Table::Marks))?;
    let first = |wanted: Table| of(wanted).next().map(|(.., text)| text);
    let marks = first(Table::Marks);
    let marks = marks.ok_or_else(|| unexpected(folder, "no table of marked points", PROJECT))?;
    let network = from_dbat(DbatTexts {
        marks: marks.named(),
        camera: camera.named(),
        control: first(Table::Control).map(Text::named),
        images: first(Table::Images).map(Text::named),
        stations: first(Table::Stations).map(Text::named),
    })?;
    let mut told = Vec::new();
    for (table, what) in [
        (Table::Control, "control points"),
        (Table::Images, "names of images"),
        (Table::Stations, "stations"),
    ] {
        if let [taken, others @ ..] = &paths(table)[..]
            && !others.is_empty()
        {
            told.push(format!(
                "{what} are those of {}; not read: {}",
                listed(&[taken]),
                listed(others)
            ));
        }
    }
    if first(Table::Control).is_some() {
        told.push(
            "lengths are in the unit of the control points, which their file does not name: read mm as that unit"
                .to_owned(),
        );
    }
    Ok(Source { network, told })
}

fn colmap(folder: &Path) -> Result<Source, ImportingError> {
    const FILES: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];
    /// Where COLMAP puts its models.
    const PLACES: [&str; 4] = ["", "sparse/0", "sparse", "0"];
    let models = PLACES.map(|place| folder.join(place));
    let Some(model) = models.iter().find(|model| model.join(FILES[0]).is_file()) else {
        let is_binary = models
            .iter()
            .any(|model| model.join("cameras.bin").is_file());
        let (found, expected) = if is_binary {
            (
                "a binary model",
                "a text model (colmap model_converter --output_type TXT)".to_owned(),
            )
        } else {
            (
                "no cameras.txt",
                format!("a COLMAP text model: {}", FILES.join(", ")),
            )
        };
        return Err(unexpected(folder, found, expected));
    };
    let [cameras, images, points] = FILES.map(|file| Text::read(&model.join(file)));
    let (cameras, images, points) = (cameras?, images?, points?);
    let network = from_colmap(ColmapTexts {
        cameras: cameras.named(),
        images: images.named(),
        points: points.named(),
    })?;
    Ok(Source {
        network,
        told: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_known_by_what_they_hold() {
        for (text, table) in [
            ("# image, path\n 1, cam/a.jpg\n", Some(Table::Images)),
            ("1, 2, 10.5, 20.5\n", Some(Table::Marks)),
            ("1, 2, 10, 20, 0.1\n1, 3, 11, 21, 0.1\n", Some(Table::Marks)),
            ("1001,CP1,0,1,0\n1002,CP2,1,1,0\n", Some(Table::Control)),
            (
                "1001,CP1,0,1,0,0.1\n1002,CP2,1,1,0,0.1\n",
                Some(Table::Control),
            ),
            (
                "1, 1, 0, 0, 9, 0, 0, 0, 1, 1, 1, 1, 1, 1, a.jpg\n",
                Some(Table::Stations),
            ),
            ("# nothing\n\n", None),
            ("A report, of three, words\n", None),
        ] {
            assert_eq!(Table::of(text), table, "{text}");
        }
    }
}
