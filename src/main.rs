//! The command line: arguments in, exit status out.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::{ArgGroup, Args, Parser, Subcommand, ValueEnum};
use tiepoint::adjustment::OutlierTest;
use tiepoint::commands::{self, CommandError, Failure};
use tiepoint::geometry::Scale;
use tiepoint::monitor::Monitor;
use tiepoint::network::{IdentificationRule, Stage};
use tiepoint::plain_network::Weights;
use tiepoint::report::{ExistingNames, NamingSettings};
use tiepoint::targets::Family;
use tiepoint::targets::sheet::{IdList, SheetSettings, Tone};
use tiepoint::ui::window::{self, Beginning, WindowError};

/// Industrial vision metrology: from photographs of coded and plain targets to coordinates with true sigmas.
#[derive(Parser)]
#[command(version, about, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Project to open in the window; without one the window is empty.
    project: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Command {
    /// Render the box experiment of Hattori et al. (2002) and measure it in the window; without a display, headless.
    Demo(Demo),
    /// Make a project from images.
    New(New),
    /// Add images to a project; the rest stays measured.
    Add(Images),
    /// Exclude images of a project; the rest stays measured.
    Exclude(Images),
    /// Run the stages of a project: all, or up to and including one.
    Run(RunArguments),
    /// Find targets and read codes in single images.
    Detect(DetectArguments),
    /// Write coordinates, observations, stations and cameras of a project.
    Export(Export),
    /// Compare a project's coordinates with known ones by a best fit.
    Compare(Compare),
    /// Give plain targets the names of approximate coordinates.
    Name(Name),
    /// Adjust a network without pictures.
    Adjust(AdjustArguments),
    /// Make a project of another program's network.
    Import(Import),
    /// Write the table of a code family, or sheets of its targets to print.
    Codes(Codes),
}

impl Command {
    /// Whether it looks at the interrupt: Ctrl-C ends the others at once, which write whole files and projects or nothing.
    fn obeys_interrupt(&self) -> bool {
        match self {
            Self::Demo(_)
            | Self::New(_)
            | Self::Add(_)
            | Self::Run(_)
            | Self::Detect(_)
            | Self::Adjust(_)
            | Self::Import(_) => true,
            Self::Exclude(_)
            | Self::Export(_)
            | Self::Compare(_)
            | Self::Name(_)
            | Self::Codes(_) => false,
        }
    }
}

#[derive(Args)]
struct Demo {
    /// Folder of the demo's pictures, project and tables.
    #[arg(default_value = "tiepoint-demo")]
    folder: PathBuf,
    /// Seed of the scene: places of targets, stations, noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Render the scene without the reference cross.
    #[arg(long)]
    no_cross: bool,
}

impl From<Demo> for commands::DemoRequest {
    fn from(demo: Demo) -> Self {
        let cross = if demo.no_cross {
            commands::DemoCross::Absent
        } else {
            commands::DemoCross::Present
        };
        Self {
            folder: demo.folder,
            seed: demo.seed,
            cross,
        }
    }
}

#[derive(Args)]
struct New {
    /// Project file to make.
    project: PathBuf,
    /// Image files, or folders of images.
    #[arg(long, required = true, num_args = 1..)]
    images: Vec<PathBuf>,
    /// Camera file; several are matched by image size and EXIF model.
    #[arg(long)]
    camera: Vec<PathBuf>,
    /// Sizes of the targets.
    #[arg(long)]
    targets: Option<PathBuf>,
    /// Points of the reference cross.
    #[arg(long)]
    cross: Option<PathBuf>,
    /// Scale bars.
    #[arg(long)]
    bars: Option<PathBuf>,
    /// Points with known coordinates.
    #[arg(long)]
    control: Option<PathBuf>,
    /// Code families: dot420, ring12, ring14, ring20.
    #[arg(long, value_delimiter = ',', default_value = "dot420")]
    codes: Vec<Family>,
    /// Identify plain targets by what is known of rays and chance, or by the threshold of Hattori et al. (2002).
    #[arg(long, value_enum, default_value_t = Rule::Statistics)]
    identification: Rule,
}

/// How plain targets are identified.
#[derive(Clone, Copy, ValueEnum)]
enum Rule {
    Statistics,
    Paper,
}

impl From<Rule> for IdentificationRule {
    fn from(rule: Rule) -> Self {
        match rule {
            Rule::Statistics => Self::Statistics,
            Rule::Paper => Self::Paper,
        }
    }
}

#[derive(Args)]
struct Images {
    /// Project file.
    project: PathBuf,
    /// Image files, or folders of images.
    #[arg(long, required = true, num_args = 1..)]
    images: Vec<PathBuf>,
}

#[derive(Args)]
struct AdjustArguments {
    /// File of the network (JSON).
    #[arg(long)]
    network: PathBuf,
    /// Reject image points whose |w| exceeds this, one at a time; without it all are used.
    #[arg(long, value_name = "W", num_args = 0..=1, default_missing_value = "4")]
    reject: Option<f64>,
    /// What |w| is compared with: its robust scale, the given standard deviations (w), or sigma0 (Pope's tau).
    #[arg(long, value_enum, default_value_t = Test::Robust)]
    test: Test,
    /// Multiply the standard deviations of image points (by camera) and of distances by their variance components.
    #[arg(long)]
    components: bool,
    /// What the coordinates refer to: all, control, or names of points separated by commas; without it as the file says.
    #[arg(long, value_name = "POINTS")]
    datum: Option<String>,
    /// Tell the distance of two points with its standard deviation; may be given several times.
    #[arg(long, value_name = "A,B")]
    distance: Vec<String>,
    /// Tell the angle at the second of three points; may be given several times.
    #[arg(long, value_name = "A,B,C")]
    angle: Vec<String>,
    /// Write the whole covariance matrix to this file (CSV).
    #[arg(long, value_name = "FILE")]
    covariance: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// How gross errors are told.
#[derive(Clone, Copy, ValueEnum)]
enum Test {
    Robust,
    W,
    Tau,
}

impl From<Test> for OutlierTest {
    fn from(test: Test) -> Self {
        match test {
            Test::Robust => Self::RobustScale,
            Test::W => Self::APriori,
            Test::Tau => Self::APosteriori,
        }
    }
}

#[derive(Args)]
struct Import {
    /// The program that wrote the files: aicon, dbat or colmap.
    #[arg(long, value_name = "PROGRAM")]
    from: commands::Program,
    /// Folder of its files; pictures are looked for there and in the folders in it.
    folder: PathBuf,
    /// Project file to make.
    project: PathBuf,
}

#[derive(Args)]
struct RunArguments {
    /// Project file.
    project: PathBuf,
    /// Last stage to run: detect, first-pair, connect, adjust-codes, identify or adjust.
    #[arg(long)]
    until: Option<Stage>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct DetectArguments {
    /// Image files.
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Camera file; only the image size is compared.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Code families: dot420, ring12, ring14, ring20.
    #[arg(long, value_delimiter = ',', default_value = "dot420")]
    codes: Vec<Family>,
    /// Folder for a picture of each image with what was found and what was refused, and why.
    #[arg(long)]
    overlay: Option<PathBuf>,
    /// Print all targets as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct Export {
    /// Project file.
    project: PathBuf,
    /// Adjusted points (CSV).
    #[arg(long)]
    points: Option<PathBuf>,
    /// Every detected target (CSV).
    #[arg(long)]
    observations: Option<PathBuf>,
    /// Targets that images ought to show and do not, with the reasons (CSV).
    #[arg(long)]
    missing: Option<PathBuf>,
    /// Oriented images (CSV).
    #[arg(long)]
    stations: Option<PathBuf>,
    /// Cameras (TOML).
    #[arg(long)]
    cameras: Option<PathBuf>,
}

#[derive(Args)]
struct Compare {
    /// Project file.
    project: PathBuf,
    /// Known coordinates (CSV).
    #[arg(long)]
    reference: PathBuf,
    /// Estimate a scale too.
    #[arg(long)]
    with_scale: bool,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct Name {
    /// Project file.
    project: PathBuf,
    /// Names with approximate coordinates, in any frame (CSV).
    #[arg(long)]
    reference: PathBuf,
    /// Within what distance a target is at a known place, mm; without it a third of the smallest spacing of the reference,
    /// but no more than a hundredth of its extent.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    within: Option<f64>,
    /// Estimate a scale too.
    #[arg(long)]
    with_scale: bool,
    /// Have names that targets have already give way to the reference's.
    #[arg(long)]
    rename: bool,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
#[command(group(ArgGroup::new("file").required(true)))]
struct Codes {
    /// Table file (CSV).
    #[arg(long, group = "file")]
    table: Option<PathBuf>,
    /// Sheet of targets to print (PDF or SVG, by the file's ending), true to size on A4.
    #[arg(long, group = "file")]
    sheet: Option<PathBuf>,
    /// Code family: dot420, ring12, ring14 or ring20.
    #[arg(long, default_value = "dot420")]
    family: Family,
    /// Numbers of the codes: ranges and lists such as 1-32,40.
    #[arg(long, default_value = "1-32", conflicts_with = "table")]
    ids: IdList,
    /// Pitch of a dot420 code, mm; ring codes have none.
    #[arg(
        long,
        default_value_t = 5.0,
        conflicts_with = "table",
        allow_negative_numbers = true
    )]
    pitch_mm: f64,
    /// Diameter of the dots, mm; a ring lies between 2 and 3 of their radii.
    #[arg(
        long,
        default_value_t = 5.0,
        conflicts_with = "table",
        allow_negative_numbers = true
    )]
    dot_mm: f64,
    /// Codes to a page, in rows; without it as many as fit.
    #[arg(long, conflicts_with = "table")]
    per_page: Option<u32>,
    /// Black targets on white instead of white ones on black.
    #[arg(long, conflicts_with = "table")]
    invert: bool,
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() && !is_help(&error) => {
            commands::report_failure(&CommandError::input(one_line(&error)));
            return ExitCode::from(2);
        }
        Err(help) => help.exit(),
    };
    let result = match arguments.command {
        None => beginning(arguments.project).and_then(show),
        Some(Command::Demo(demo)) => show_demo(demo.into()),
        Some(command) if command.obeys_interrupt() => headless(|monitor| run(command, monitor)),
        Some(command) => run(command, &Monitor::new()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            commands::report_failure(&error);
            match error.failure {
                Failure::Work => ExitCode::from(1),
                Failure::Input => ExitCode::from(2),
                Failure::Window => ExitCode::from(3),
                Failure::Interrupted => ExitCode::from(130),
            }
        }
    }
}

/// Does something that Ctrl-C stops after the step under way.
fn headless(work: impl FnOnce(&Monitor) -> Result<(), CommandError>) -> Result<(), CommandError> {
    let monitor = Arc::new(commands::monitor_on_terminal());
    let interrupted = Arc::clone(&monitor);
    // Without a handler Ctrl-C would end the program between two steps' saves: nothing is lost, only less is said.
    let _ = ctrlc::set_handler(move || interrupted.interrupt());
    work(&monitor)
}

/// What the window begins with: a path that leads nowhere is told before there is a window.
fn beginning(project: Option<PathBuf>) -> Result<Beginning, CommandError> {
    match project {
        None => Ok(Beginning::Empty),
        Some(path) if path.is_file() => Ok(Beginning::Project(path)),
        Some(path) => Err(CommandError::input(format!(
            "{}: found no file, expected a project or a command (tiepoint --help lists them)",
            path.display()
        ))),
    }
}

/// Opens the window.
fn show(beginning: Beginning) -> Result<(), CommandError> {
    window::open(beginning).map_err(without_window)
}

fn without_window(error: WindowError) -> CommandError {
    match error {
        WindowError::NotSaved(line) => CommandError::work(line),
        other => CommandError::window(other.to_string()),
    }
}

/// The demo in the window, or headless where there is no display.
fn show_demo(request: commands::DemoRequest) -> Result<(), CommandError> {
    match window::open(Beginning::Demo(request.clone())) {
        Err(no_display @ WindowError::NoDisplay) => {
            commands::report(&format!("{no_display}: the demo runs headless"));
            headless(|monitor| commands::demo(&request, monitor))
        }
        other => other.map_err(without_window),
    }
}

fn is_help(error: &clap::Error) -> bool {
    error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
}

/// What is wrong with the arguments, without the usage below it: `--help` shows that.
fn one_line(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let message = text.split("\n\nUsage:").next().unwrap_or_default();
    let message = message
        .split("\n\nFor more information")
        .next()
        .unwrap_or_default();
    let words: Vec<&str> = message.split_whitespace().collect();
    let line = words.join(" ");
    line.strip_prefix("error: ").unwrap_or(&line).to_owned()
}

fn run(command: Command, monitor: &Monitor) -> Result<(), CommandError> {
    match command {
        Command::Demo(demo) => commands::demo(&demo.into(), monitor),
        Command::New(new) => {
            let request = commands::NewRequest {
                project: new.project,
                images: new.images,
                cameras: new.camera,
                targets: new.targets,
                cross: new.cross,
                bars: new.bars,
                control: new.control,
                families: new.codes,
                identification: new.identification.into(),
            };
            commands::new(&request, monitor)
        }
        Command::Add(images) => commands::add(&images.project, &images.images, monitor),
        Command::Exclude(images) => commands::exclude(&images.project, &images.images),
        Command::Run(run) => {
            let until = run.until.unwrap_or(Stage::Adjust);
            commands::run(
                &run.project,
                until,
                commands::Form::of_json(run.json),
                monitor,
            )
        }
        Command::Detect(detect) => commands::detect(
            &commands::DetectRequest {
                images: detect.images,
                camera: detect.camera,
                families: detect.codes,
                overlay: detect.overlay,
            },
            commands::Form::of_json(detect.json),
            monitor,
        ),
        Command::Export(export) => commands::export(&commands::ExportRequest {
            project: export.project,
            points: export.points,
            observations: export.observations,
            missing: export.missing,
            stations: export.stations,
            cameras: export.cameras,
        }),
        Command::Compare(compare) => commands::compare(
            &compare.project,
            &compare.reference,
            scale(compare.with_scale),
            commands::Form::of_json(compare.json),
        ),
        Command::Name(name) => commands::name(
            &commands::NameRequest {
                project: name.project,
                reference: name.reference,
                settings: NamingSettings {
                    scale: scale(name.with_scale),
                    within_mm: name.within,
                    existing: if name.rename {
                        ExistingNames::GiveWay
                    } else {
                        ExistingNames::Stay
                    },
                    ..NamingSettings::default()
                },
            },
            commands::Form::of_json(name.json),
        ),
        Command::Adjust(adjust) => commands::adjust(
            &commands::AdjustRequest {
                network: adjust.network,
                reject: adjust.reject,
                test: adjust.test.into(),
                weights: if adjust.components {
                    Weights::FromResiduals
                } else {
                    Weights::AsGiven
                },
                datum: adjust.datum,
                distances: adjust.distance,
                angles: adjust.angle,
                covariance: adjust.covariance,
            },
            commands::Form::of_json(adjust.json),
            monitor,
        ),
        Command::Import(import) => {
            let request = commands::ImportRequest {
                program: import.from,
                folder: import.folder,
                project: import.project,
            };
            commands::import(&request, monitor)
        }
        Command::Codes(codes) => write_codes(codes),
    }
}

/// The scale of a best fit where one was asked for.
fn scale(with_scale: bool) -> Scale {
    if with_scale { Scale::Free } else { Scale::One }
}

fn write_codes(codes: Codes) -> Result<(), CommandError> {
    if let Some(table) = &codes.table {
        commands::codes(table, codes.family)?;
    }
    let Some(file) = codes.sheet else {
        return Ok(());
    };
    commands::codes_sheet(&commands::SheetRequest {
        file,
        settings: SheetSettings {
            family: codes.family,
            ids: codes.ids,
            pitch_mm: codes.pitch_mm,
            dot_mm: codes.dot_mm,
            per_page: codes.per_page,
            targets: if codes.invert {
                Tone::Black
            } else {
                Tone::White
            },
        },
    })
}
