//! What the operator asks for.

use serde::{Deserialize, Serialize};

use super::Expansion;
use crate::targets::Family;

/// Sizes of the dots of one code family.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DotFamily {
    /// The family.
    pub family: Family,
    /// Pitch of the `dot420` grid, mm.
    pub pitch_mm: f64,
    /// Diameter of its dots, mm.
    pub dot_mm: f64,
}

/// Sizes of the targets in use, and what warmth does to the object that carries them (`targets.toml`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetSizes {
    /// Families with sizes of their own; the others have 5 mm.
    pub families: Vec<DotFamily>,
    /// Diameter of plain targets, mm.
    pub plain_dot_mm: f64,
    /// What warmth does to the object: its temperature at the photographs, and the one for which coordinates are
    /// delivered. `None`: it is measured as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<Expansion>,
}

/// Default pitch and diameter of dots, mm (Hattori et al., 2002, figure 2a and 3).
const DEFAULT_DOT_MM: f64 = 5.0;

impl Default for TargetSizes {
    fn default() -> Self {
        Self {
            families: Vec::new(),
            plain_dot_mm: DEFAULT_DOT_MM,
            object: None,
        }
    }
}

impl TargetSizes {
    /// The sizes of a family.
    #[must_use]
    pub fn of(&self, family: Family) -> DotFamily {
        self.families
            .iter()
            .find(|f| f.family == family)
            .cloned()
            .unwrap_or(DotFamily {
                family,
                pitch_mm: DEFAULT_DOT_MM,
                dot_mm: DEFAULT_DOT_MM,
            })
    }
}

/// How an image that shows the reference cross gets its first orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DevicePose {
    /// By the nominal principal distance; of a flat view both poses are kept until the network decides. The more exact one.
    #[default]
    Nominal,
    /// By the eleven-parameter DLT without any (Hattori et al., 2002), where two dots or more are raised; its interior
    /// orientation is disregarded. The other one where it cannot be had.
    Dlt,
}

/// How plain targets are identified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IdentificationRule {
    /// By how exactly rays, orientations and ellipses are known, and by what chance would do: names more, and hardly a wrong one.
    #[default]
    Statistics,
    /// By the threshold of Hattori et al. (2002) for each two rays of images that share codes: the baseline.
    Paper,
}

/// What the adjustments do with observations that fail the test for gross errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GrossErrors {
    /// They are rejected.
    #[default]
    Reject,
    /// They are kept: another program has taken out what it would not use. While images are connected they are rejected
    /// all the same.
    Keep,
}

/// What the operator asks for; changing any of it is an edit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasurementSettings {
    /// Code families to look for.
    pub families: Vec<Family>,
    /// Sizes of the targets.
    pub targets: TargetSizes,
    /// Seed of every search by random samples.
    pub seed: u64,
    /// Images detected in one step; the same whatever the cores, so that steps are the same everywhere.
    pub detection_batch: usize,
    /// Critical value of |w| above which the adjustment rejects an observation; 4.0 rejects one good observation in 16,000.
    pub critical_w: f64,
    /// Whether it does.
    #[serde(default)]
    pub gross_errors: GrossErrors,
    /// Fewest rays of a plain target.
    pub min_rays: u32,
    /// How plain targets are identified.
    #[serde(default)]
    pub identification: IdentificationRule,
    /// First orientation from the reference cross.
    #[serde(default)]
    pub device_pose: DevicePose,
}

impl Default for MeasurementSettings {
    fn default() -> Self {
        Self {
            families: vec![Family::Dot420],
            targets: TargetSizes::default(),
            seed: 1,
            detection_batch: 16,
            critical_w: 4.0,
            gross_errors: GrossErrors::default(),
            min_rays: 3,
            identification: IdentificationRule::default(),
            device_pose: DevicePose::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_earlier_projects_identify_by_statistics() {
        let settings = MeasurementSettings {
            identification: IdentificationRule::Paper,
            ..MeasurementSettings::default()
        };
        let mut json = serde_json::to_value(&settings).unwrap();
        assert_eq!(json["identification"], "paper");
        let read: MeasurementSettings = serde_json::from_value(json.clone()).unwrap();
        assert_eq!(read, settings);
        json.as_object_mut().unwrap().remove("identification");
        let earlier: MeasurementSettings = serde_json::from_value(json).unwrap();
        assert_eq!(earlier, MeasurementSettings::default());
    }
}
