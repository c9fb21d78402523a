//! What leaves the program: tables, CSV, TOML, JSON, sheets of targets, pictures with what was found in them.
//!
//! Everything is made from a [`crate::network::Network`] as a text or as a value to serialise, and only [`write_file`]
//! touches the disk. Numbers name their unit in the header. No stale number passes for a fresh one: what is derived
//! from an adjustment is refused where the adjustment is older than its inputs ([`NoFigures`]).

mod camera_file;
mod codes;
mod compare;
mod connectivity;
mod csv_text;
mod detect;
mod export;
mod file;
#[cfg(test)]
pub(crate) mod fixture;
mod missing;
mod naming;
mod overlay;
mod plain_answers;
mod plain_network;
mod plain_reliability;
mod sheet_pdf;
mod sheet_svg;
mod summary;
mod truth_check;

pub use camera_file::{CameraFile, cameras_toml, direction_name};
pub use codes::codes_csv;
pub use compare::{
    Agreement, CompareError, CompareSettings, Comparison, Counterpart, Difference, ReferencePoint,
    compare,
};
pub use connectivity::connectivity_table;
pub use csv_text::csv_text;
pub use detect::{DetectReport, detect_line};
pub use export::{NoFigures, export_cameras, export_observations, export_points, export_stations};
pub use file::{SameFile, WriteError, check_apart, write_file};
pub use missing::{export_missing, missing_by_class};
pub use naming::{
    Ambiguity, ExistingNames, Naming, NamingError, NamingSettings, ReferenceLeft, Rival,
    TargetLeft, Way, WhyLeft, name_by_reference,
};
pub use overlay::overlay;
pub use plain_answers::{
    CheckDistanceRow, CheckPointRow, DerivedRow, NoAnswer, PlainAnswers, Question, asks,
    covariance_csv,
};
pub use plain_network::{
    CameraRow, DistanceRow, ImageRow, KnownRow, ObservationRow, ParameterRow, PlainReport, PointRow,
};
pub use plain_reliability::{ComponentRow, ReliabilityReport, Sigma0Row, SignificanceRow};
pub use sheet_pdf::sheet_pdf;
pub use sheet_svg::sheet_svg;
pub use summary::{BarReport, FindingReport, RunSummary, StageRun};
pub use truth_check::{TruthCheck, check_against_truth};
