//! What can be done with files and folders that were dropped on the window.
//!
//! The names are those of the files a user writes: `camera.toml`, `targets.toml`, `cross.csv`, `bars.csv`, `control.csv`.
//! In folders only these very names count (results such as `cameras.toml` or a truth such as `reference.csv` may lie
//! beside them); a file that was dropped itself was meant, so the beginning of its name is enough.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::intake::has_image_extension;
use super::making::ProjectPlan;

/// Extension of project files.
pub const PROJECT_EXTENSION: &str = "tiepoint";

/// What dropped files and folders are good for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Proposal {
    /// A project to open.
    Open(PathBuf),
    /// A project to make.
    New(Box<NewProject>),
    /// Nothing, and why, in one line.
    Nothing(String),
}

/// A project that can be made; the operator looks at it first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewProject {
    /// Of what: every image by itself, and a project file that does not exist yet.
    pub plan: ProjectPlan,
    /// Projects that lie there already: perhaps one of them was meant.
    pub projects_there: Vec<PathBuf>,
    /// Dropped files that are of no use for a project.
    pub not_used: Vec<PathBuf>,
}

/// What the files beside the pictures are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Camera,
    Targets,
    Cross,
    Bars,
    Control,
}

const PARTS: [(Part, &str, &str); 5] = [
    (Part::Camera, "camera", "toml"),
    (Part::Targets, "targets", "toml"),
    (Part::Cross, "cross", "csv"),
    (Part::Bars, "bars", "csv"),
    (Part::Control, "control", "csv"),
];

/// What was found in and beside the dropped paths.
#[derive(Default)]
struct Haul {
    images: BTreeSet<PathBuf>,
    /// Folders whose files belong to the images, the closest first.
    places: Vec<PathBuf>,
    projects: BTreeSet<PathBuf>,
    parts: Vec<(Part, PathBuf)>,
    not_used: Vec<PathBuf>,
}

/// What can be done with files and folders. Looks at names only, and into folders and, where a folder has no images
/// itself, into those in it.
#[must_use]
pub fn propose(paths: &[PathBuf]) -> Proposal {
    let paths: Vec<PathBuf> = paths.iter().map(|path| absolute(path)).collect();
    if let Some(project) = paths.iter().find(|path| is_project(path)) {
        return Proposal::Open(project.clone());
    }
    let mut haul = Haul::default();
    for path in &paths {
        if path.is_dir() {
            haul.add_folder(path);
        } else {
            haul.add_file(path);
        }
    }
    let Some(first) = haul.images.first() else {
        return without_images(&paths, &haul);
    };
    let own_folder = || first.parent().unwrap_or(first).to_owned();
    let home = (paths.iter().find(|path| path.is_dir()).cloned()).unwrap_or_else(own_folder);
    let mut plan =
        ProjectPlan::of_images(free_project(&home), haul.images.iter().cloned().collect());
    for (part, stem, extension) in PARTS {
        let dropped = haul.parts.iter().filter(|(of, _)| *of == part);
        let mut files: Vec<PathBuf> = dropped.map(|(_, file)| file.clone()).collect();
        if files.is_empty() {
            let name = format!("{stem}.{extension}");
            let there = haul.places.iter().map(|place| place.join(&name));
            files.extend(there.filter(|file| file.is_file()).take(1));
        }
        let only = files.first().cloned();
        match part {
            Part::Camera => plan.cameras = files,
            Part::Targets => plan.targets = only,
            Part::Cross => plan.cross = only,
            Part::Bars => plan.bars = only,
            Part::Control => plan.control = only,
        }
    }
    Proposal::New(Box::new(NewProject {
        plan,
        projects_there: haul.projects.into_iter().collect(),
        not_used: haul.not_used,
    }))
}

/// What folders without images are good for.
fn without_images(paths: &[PathBuf], haul: &Haul) -> Proposal {
    let projects: Vec<&PathBuf> = haul.projects.iter().collect();
    match (projects.as_slice(), paths) {
        ([only], _) => Proposal::Open((*only).clone()),
        (_, []) => Proposal::Nothing("found nothing, expected images or a project".into()),
        ([], [first, ..]) => Proposal::Nothing(format!(
            "{}: found no images and no project, expected images (.png, .jpg, .tif ...), a folder of images, or a .{PROJECT_EXTENSION} file",
            first.display()
        )),
        (several, [first, ..]) => Proposal::Nothing(format!(
            "{}: found {} projects, expected one of them",
            first.display(),
            several.len()
        )),
    }
}

impl Haul {
    fn add_folder(&mut self, folder: &Path) {
        let entries = sorted(folder);
        let images = images_of(&entries);
        self.projects
            .extend(entries.iter().filter(|e| is_project(e)).cloned());
        if images.is_empty() {
            for inner in entries.iter().filter(|entry| entry.is_dir()) {
                let images = images_of(&sorted(inner));
                if !images.is_empty() {
                    self.images.extend(images);
                    self.add_place(inner);
                }
            }
            self.add_place(folder);
        } else {
            self.images.extend(images);
            self.add_place(folder);
            // Pictures often lie in a folder of their own, the files beside that.
            if let Some(parent) = folder.parent() {
                self.add_place(parent);
            }
        }
    }

    fn add_file(&mut self, file: &Path) {
        if !file.is_file() {
            self.not_used.push(file.to_owned());
        } else if has_image_extension(file) {
            self.images.insert(file.to_owned());
            if let Some(folder) = file.parent() {
                self.add_place(folder);
            }
        } else if let Some(part) = part_of(file) {
            self.parts.push((part, file.to_owned()));
        } else {
            self.not_used.push(file.to_owned());
        }
    }

    fn add_place(&mut self, folder: &Path) {
        if !self.places.iter().any(|place| place == folder) {
            self.places.push(folder.to_owned());
        }
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// What lies in a folder, by name; nothing where it cannot be read.
fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

fn images_of(entries: &[PathBuf]) -> Vec<PathBuf> {
    let images = entries
        .iter()
        .filter(|e| has_image_extension(e) && e.is_file());
    images.cloned().collect()
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

fn is_project(path: &Path) -> bool {
    has_extension(path, PROJECT_EXTENSION) && path.is_file()
}

/// What a file that was dropped itself is for, by the beginning of its name.
fn part_of(file: &Path) -> Option<Part> {
    let stem = file.file_stem()?.to_string_lossy().to_lowercase();
    let fits = |(_, name, extension): &&(Part, &str, &str)| {
        has_extension(file, extension) && stem.starts_with(name)
    };
    PARTS.iter().find(fits).map(|(part, ..)| *part)
}

/// A project file in a folder, named after it, that does not exist yet.
fn free_project(folder: &Path) -> PathBuf {
    let name = folder
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    let name = name.unwrap_or_else(|| "project".into());
    let numbered = (2..).map(|number| format!("{name}-{number}.{PROJECT_EXTENSION}"));
    std::iter::once(format!("{name}.{PROJECT_EXTENSION}"))
        .chain(numbered)
        .map(|name| folder.join(name))
        .find(|project| fs::symlink_metadata(project).is_err())
        .unwrap_or_else(|| folder.join(PROJECT_EXTENSION))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::sample_folder::Folder;

    fn new_project(paths: &[PathBuf]) -> NewProject {
        match propose(paths) {
            Proposal::New(new) => *new,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_project_is_opened() {
        let folder = Folder::new("propose-open");
        let project = folder.write("a/p.tiepoint", b"");
        let image = folder.picture("a/1.pgm", 1);
        assert_eq!(
            propose(&[image, project.clone()]),
            Proposal::Open(project.clone())
        );
        // A folder of images is perhaps to become another project.
        assert_eq!(new_project(&[folder.at("a")]).projects_there, [project]);
        let alone = folder.write("b/q.TIEPOINT", b"");
        assert_eq!(propose(&[folder.at("b")]), Proposal::Open(alone));
    }

    #[test]
    fn a_folder_of_images_takes_the_files_beside_them() {
        let folder = Folder::new("propose-folder");
        for (name, grey) in [("2.pgm", 2), ("1.pgm", 1)] {
            folder.picture(&format!("job/images/{name}"), grey);
        }
        for name in [
            "camera.toml",
            "cross.csv",
            "bars.csv",
            "cameras.toml",
            "reference.csv",
        ] {
            folder.write(&format!("job/{name}"), b"");
        }
        let job = folder.at("job");
        // The folder of the images, or the one that holds it.
        for dropped in ["job/images", "job"] {
            let NewProject { plan, .. } = new_project(&[folder.at(dropped)]);
            let images = ["1.pgm", "2.pgm"].map(|name| job.join("images").join(name));
            assert_eq!(plan.images, images);
            assert_eq!(plan.cameras, [job.join("camera.toml")]);
            assert_eq!(plan.cross, Some(job.join("cross.csv")));
            assert_eq!(plan.bars, Some(job.join("bars.csv")));
            assert_eq!((plan.targets, plan.control), (None, None));
            let name = folder.at(dropped);
            let name = format!("{}.tiepoint", name.file_name().unwrap().to_str().unwrap());
            assert_eq!(plan.project, folder.at(dropped).join(name));
        }
        folder.write("job/job.tiepoint", b"");
        folder.write("job/images/camera.toml", b"");
        let NewProject { plan, .. } = new_project(std::slice::from_ref(&job));
        assert_eq!(plan.project, job.join("job-2.tiepoint"));
        assert_eq!(
            plan.cameras,
            [job.join("images/camera.toml")],
            "the closest"
        );
    }

    #[test]
    fn dropped_files_are_meant_themselves() {
        let folder = Folder::new("propose-files");
        let image = folder.picture("1.pgm", 1);
        folder.write("camera.toml", b"");
        let [left, right, bars, notes] = [
            "camera-left.toml",
            "camera-right.toml",
            "Bars 2024.CSV",
            "notes.txt",
        ]
        .map(|name| folder.write(name, b""));
        let gone = folder.at("gone.png");
        let dropped = [&image, &left, &right, &bars, &notes, &gone].map(Clone::clone);
        let NewProject { plan, not_used, .. } = new_project(&dropped);
        assert_eq!(plan.images, [image]);
        assert_eq!(plan.cameras, [left, right]);
        assert_eq!(plan.bars, Some(bars));
        assert_eq!(not_used, [notes, gone]);
    }

    #[test]
    fn what_is_of_no_use_is_told() {
        let folder = Folder::new("propose-nothing");
        let notes = folder.write("notes.txt", b"");
        for paths in [vec![], vec![notes], vec![folder.at(".")]] {
            let proposal = propose(&paths);
            let Proposal::Nothing(line) = proposal else {
                panic!("{proposal:?}")
            };
            assert!(line.contains("expected"), "{line}");
        }
    }
}
