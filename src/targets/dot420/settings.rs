//! What is known of the targets beforehand, and how far the measurements are trusted.

use serde::{Deserialize, Serialize};

use super::NominalCamera;

/// Settings of [`super::read_dot420`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Dot420Settings {
    /// Pitch of the code's grid, mm; default 5.
    pub pitch_mm: f64,
    /// Diameter of the dots, mm; default 5. Only its ratio to the pitch matters here.
    pub dot_mm: f64,
    /// Standard deviation of a dot's place on its plane, pitches: print, curvature of the surface and lens distortion
    /// inside the code; default 0.0035 (0.02 mm at a pitch of 5 mm).
    pub grid_sigma_pitches: f64,
    /// Standard deviation added to each centre, px, because a dot's own sigma knows nothing of its surroundings;
    /// default 0.02.
    pub centre_sigma_px: f64,
    /// Standardised misfit up to which a reading is certain; default 1.8, which chance exceeds
    /// once in 300 at worst (chi-square with six degrees of freedom, where the centres' own sigmas dominate).
    pub certain_misfit: f64,
    /// Standardised misfit beyond which a reading is refused; between the two it carries a doubt; default 6
    /// (0.1 mm at a pitch of 5 mm: a curved surface).
    pub refused_misfit: f64,
    /// Trust in an outline's semi-axes, px: blur and pixel size; default 0.35.
    pub outline_px: f64,
    /// Trust in an outline's semi-axes as a share of their length, beyond a size error common to all six; default 0.09.
    pub outline_share: f64,
    /// Size error common to all dots (halation, threshold, wrong `dot_mm`) as a share of the diameter; default 0.2.
    pub common_size_share: f64,
    /// Largest relative difference of the squared semi-axes of the six dots' mean shape on the code's plane, blur apart; default
    /// 0.08, more than four times what six outlines good to 3 % give. It tells a code from a field of targets in rows that
    /// would be a code if its plane were tilted otherwise.
    pub refused_ovalness: f64,
    /// Largest ratio of depth (or scale) from one side of the code to the other; default 1.3.
    pub depth_ratio: f64,
    /// Largest ratio of the contrasts of the six dots; default 4.
    pub contrast_ratio: f64,
    /// Distance, pitches, within which no foreign dot of the same plane can stand from a code's dot: the design keeps 3;
    /// default 2.6. One or two such dots are a doubt, more mean a field of plain targets.
    pub clear_pitches: f64,
    /// The camera, where it is known if only roughly; default none. It binds the perspective of a code's plane, and so leaves
    /// a plain target less room to pass for a code's dot: fewer wrong numbers and fewer doubts.
    pub camera: Option<NominalCamera>,
    /// Largest likelihood, as a multiple of the reading's, of all codes that would look the same if one of their dots were hidden
    /// and one of these six were a plain target; beyond it the reading carries a doubt. Default 2e-6. Wrong numbers grow in proportion
    /// to it (of a million scenes of four codes, two of them with a hidden dot, 21 at 3e-4, 7 at 1e-4, 1 at 1.5e-5); true codes
    /// that have such a rival at all, three of four among ten plain targets and half among twenty-five, are doubted until the
    /// orientation bears them out, at 1e-4 one of ten.
    pub rival_chance: f64,
}

impl Default for Dot420Settings {
    fn default() -> Self {
        Self {
            pitch_mm: 5.0,
            dot_mm: 5.0,
            grid_sigma_pitches: 0.0035,
            centre_sigma_px: 0.02,
            certain_misfit: 1.8,
            refused_misfit: 6.0,
            outline_px: 0.35,
            outline_share: 0.09,
            common_size_share: 0.2,
            refused_ovalness: 0.08,
            depth_ratio: 1.3,
            contrast_ratio: 4.0,
            clear_pitches: 2.6,
            camera: None,
            rival_chance: 2e-6,
        }
    }
}

impl Dot420Settings {
    /// Radius of a dot in pitches.
    pub(super) fn dot_radius(&self) -> f64 {
        0.5 * self.dot_mm / self.pitch_mm
    }
}
