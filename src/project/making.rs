//! Making a project from what the operator has: pictures and the files beside them.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use super::files::{FileError, read_bars, read_cameras, read_control, read_cross, read_targets};
use super::intake::{IntakeError, add_cameras, add_images};
use super::session::{Session, folder_of};
use super::storage::StorageError;
use crate::monitor::Monitor;
use crate::network::{IdentificationRule, Network};
use crate::targets::Family;

/// What a new project is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProjectPlan {
    /// Project file to make.
    pub project: PathBuf,
    /// Image files, or folders of images.
    pub images: Vec<PathBuf>,
    /// Camera files.
    pub cameras: Vec<PathBuf>,
    /// Sizes of the targets.
    pub targets: Option<PathBuf>,
    /// Points of the reference cross.
    pub cross: Option<PathBuf>,
    /// Scale bars.
    pub bars: Option<PathBuf>,
    /// Points with known coordinates.
    pub control: Option<PathBuf>,
    /// Code families.
    pub families: Vec<Family>,
    /// How plain targets are identified.
    pub identification: IdentificationRule,
}

impl ProjectPlan {
    /// A project of pictures alone: cameras from their EXIF data, the usual codes.
    #[must_use]
    pub fn of_images(project: PathBuf, images: Vec<PathBuf>) -> Self {
        Self {
            project,
            images,
            cameras: Vec::new(),
            targets: None,
            cross: None,
            bars: None,
            control: None,
            families: vec![Family::Dot420],
            identification: IdentificationRule::default(),
        }
    }
}

/// Why a project was not made, in one line.
#[derive(Debug, thiserror::Error)]
pub enum MakingError {
    /// A project never overwrites a file.
    #[error("{}: found an existing file, expected the name of a new project", project.display())]
    Exists {
        /// The project file.
        project: PathBuf,
    },
    /// A file beside the pictures is bad.
    #[error(transparent)]
    File(#[from] FileError),
    /// A picture cannot be taken in.
    #[error(transparent)]
    Intake(#[from] IntakeError),
    /// The project file cannot be written.
    #[error(transparent)]
    Storage(#[from] StorageError),
}

/// Makes a project; nothing is written where any of the files is bad. Reads every picture once, so it may take long, and obeys an
/// interrupt meanwhile.
///
/// # Errors
/// [`MakingError`] for a bad file, an existing project, a picture given twice or of another size than the cameras.
pub fn make(plan: &ProjectPlan, monitor: &Monitor) -> Result<Session, MakingError> {
    // Before any picture is looked at; `Session::create` would see it too.
    if fs::symlink_metadata(&plan.project).is_ok() {
        return Err(MakingError::Exists {
            project: plan.project.clone(),
        });
    }
    let mut network = Network::default();
    let settings = Arc::make_mut(&mut network.settings);
    settings.families = plan.families.clone();
    settings.families.sort_unstable();
    settings.families.dedup();
    settings.identification = plan.identification;
    if let Some(targets) = &plan.targets {
        settings.targets = read_targets(targets)?;
    }
    if let Some(cross) = &plan.cross {
        network.device = Arc::new(read_cross(cross)?);
    }
    if let Some(bars) = &plan.bars {
        network.scale_bars = Arc::new(read_bars(bars, &network.device)?);
    }
    if let Some(control) = &plan.control {
        network.control = Arc::new(read_control(control, &network.device)?);
    }
    for camera in &plan.cameras {
        add_cameras(&mut network, &read_cameras(camera)?);
    }
    let folder = folder_of(&plan.project);
    add_images(&mut network, &folder, &plan.images, monitor)?;
    Ok(Session::create(&plan.project, network)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::sample_folder::Folder;

    #[test]
    fn a_project_of_pictures_alone_is_made_once() {
        let folder = Folder::new("making");
        for (name, grey) in [("a.pgm", 1), ("b.pgm", 2)] {
            folder.picture(&format!("images/{name}"), grey);
        }
        let plan = ProjectPlan::of_images(folder.at("p.tiepoint"), vec![folder.at("images")]);
        let session = make(&plan, &Monitor::new()).unwrap();
        let rule = session.network().settings.identification;
        assert_eq!(rule, IdentificationRule::Statistics);
        let paths = session.network().images.values();
        let paths: Vec<&str> = paths.map(|image| image.file.path.as_str()).collect();
        assert_eq!(paths, ["images/a.pgm", "images/b.pgm"]);
        drop(session);
        let again = make(&plan, &Monitor::new()).map(drop).unwrap_err();
        assert!(matches!(again, MakingError::Exists { .. }), "{again}");
    }

    #[cfg(unix)]
    #[test]
    fn a_project_opened_through_a_link_finds_its_pictures() {
        let folder = Folder::new("making-link");
        folder.picture("job/a.pgm", 1);
        let file = folder.at("job/p.tiepoint");
        let plan = ProjectPlan::of_images(file.clone(), vec![folder.at("job/a.pgm")]);
        drop(make(&plan, &Monitor::new()).unwrap());
        std::os::unix::fs::symlink(&file, folder.at("link.tiepoint")).unwrap();
        assert_eq!(folder_of(&folder.at("link.tiepoint")), folder.at("job"));
        assert_eq!(folder_of(&file), folder.at("job"));
    }

    #[cfg(unix)]
    #[test]
    fn a_name_that_cannot_be_kept_is_refused() {
        use std::os::unix::ffi::OsStrExt;
        let folder = Folder::new("making-name");
        let name = std::ffi::OsStr::from_bytes(b"gr\xfcn.pgm");
        let picture = folder.picture("a.pgm", 1);
        let renamed = picture.with_file_name(name);
        fs::rename(&picture, &renamed).unwrap();
        let plan = ProjectPlan::of_images(folder.at("p.tiepoint"), vec![renamed]);
        let error = make(&plan, &Monitor::new()).map(drop).unwrap_err();
        assert!(error.to_string().contains("no UTF-8 text"), "{error}");
    }

    #[test]
    fn an_interrupt_leaves_nothing_behind() {
        let folder = Folder::new("making-interrupted");
        folder.picture("a.pgm", 1);
        let plan = ProjectPlan::of_images(folder.at("p.tiepoint"), vec![folder.at("a.pgm")]);
        let monitor = Monitor::new();
        monitor.interrupt();
        let error = make(&plan, &monitor).map(drop).unwrap_err();
        assert!(
            matches!(error, MakingError::Intake(IntakeError::Interrupted(_))),
            "{error}"
        );
        assert!(!plan.project.exists());
    }

    #[test]
    fn the_plan_chooses_how_targets_are_identified() {
        let folder = Folder::new("making-rule");
        folder.picture("a.pgm", 1);
        let plan = ProjectPlan {
            identification: IdentificationRule::Paper,
            ..ProjectPlan::of_images(folder.at("p.tiepoint"), vec![folder.at("a.pgm")])
        };
        let session = make(&plan, &Monitor::new()).unwrap();
        let rule = session.network().settings.identification;
        assert_eq!(rule, IdentificationRule::Paper);
    }

    #[test]
    fn a_bad_file_is_one_line_and_leaves_nothing_behind() {
        let folder = Folder::new("making-bad");
        folder.picture("a.pgm", 1);
        let bars = folder.write("bars.csv", b"name,from\n");
        let images = ProjectPlan::of_images(folder.at("p.tiepoint"), vec![folder.at("a.pgm")]);
        let bad_bars = ProjectPlan {
            bars: Some(bars),
            ..images.clone()
        };
        let bad_image = ProjectPlan {
            images: vec![folder.at("none.pgm")],
            ..images
        };
        for (plan, named) in [(bad_bars, "bars.csv"), (bad_image, "none.pgm")] {
            let line = make(&plan, &Monitor::new())
                .map(drop)
                .unwrap_err()
                .to_string();
            assert!(line.contains(named) && !line.contains('\n'), "{line}");
        }
        assert_eq!(folder.names("."), ["a.pgm", "bars.csv"]);
    }
}
