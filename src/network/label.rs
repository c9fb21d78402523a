//! Names of points.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::targets::Family;

/// The highest number of a plain target: there is always one behind it.
const LAST_TARGET: u32 = 1_000_000_000;

/// Which dot of a coded target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CodeDot {
    /// Origin of a `dot420` code, or the centre dot of a ring code.
    O,
    /// End of the x axis.
    A,
    /// End of the y axis.
    B,
    /// First code dot.
    One,
    /// Second code dot.
    Two,
    /// Third code dot.
    Three,
}

impl CodeDot {
    /// The dots of a `dot420` code in the order of its reading.
    pub const ALL: [CodeDot; 6] = [
        CodeDot::O,
        CodeDot::A,
        CodeDot::B,
        CodeDot::One,
        CodeDot::Two,
        CodeDot::Three,
    ];

    /// O, A, B, 1, 2, 3.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            CodeDot::O => "O",
            CodeDot::A => "A",
            CodeDot::B => "B",
            CodeDot::One => "1",
            CodeDot::Two => "2",
            CodeDot::Three => "3",
        }
    }
}

/// A point of the object, given once and for all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum PointId {
    /// A dot of a coded target.
    Code {
        /// Family of the code.
        family: Family,
        /// Number of the code.
        code: u32,
        /// Which of its dots.
        dot: CodeDot,
    },
    /// A dot of the exterior orientation device, by its place in the device's table.
    Device(u16),
    /// A plain target, by its number.
    Target(u32),
}

/// What kind of point, as exported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PointKind {
    /// A dot of a coded target.
    Code,
    /// A plain target.
    Target,
    /// A dot of the reference cross.
    Cross,
}

impl fmt::Display for PointKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PointKind::Code => "code",
            PointKind::Target => "target",
            PointKind::Cross => "cross",
        })
    }
}

impl PointId {
    /// The point's kind.
    #[must_use]
    pub fn kind(self) -> PointKind {
        match self {
            PointId::Code { .. } => PointKind::Code,
            PointId::Device(_) => PointKind::Cross,
            PointId::Target(_) => PointKind::Target,
        }
    }

    /// The code that this is a dot of.
    #[must_use]
    pub fn code(self) -> Option<(Family, u32)> {
        match self {
            PointId::Code { family, code, .. } => Some((family, code)),
            PointId::Device(_) | PointId::Target(_) => None,
        }
    }

    /// The points of a code in the order of its reading.
    #[must_use]
    pub fn of_code(family: Family, code: u32) -> Vec<PointId> {
        let dots: &[CodeDot] = match family {
            Family::Dot420 => &CodeDot::ALL,
            Family::Ring(_) => &[CodeDot::O],
        };
        dots.iter()
            .map(|&dot| PointId::Code { family, code, dot })
            .collect()
    }
}

impl fmt::Display for PointId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PointId::Code {
                family: Family::Dot420,
                code,
                dot,
            } => write!(f, "C{code}.{}", dot.name()),
            PointId::Code { family, code, .. } => f.write_str(&family.code_label(*code)),
            PointId::Device(index) => write!(f, "cross:{}", index + 1),
            PointId::Target(number) => write!(f, "M{number}"),
        }
    }
}

/// A text that names no point.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found label '{0}', expected one such as C17, C17.A, R14-57, M5 or a label of the cross")]
pub struct UnknownLabel(pub String);

impl FromStr for PointId {
    type Err = UnknownLabel;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        let unknown = || UnknownLabel(s.to_owned());
        let number = |text: &str| text.parse::<u32>().map_err(|_| unknown());
        if let Some(rest) = s.strip_prefix("cross:") {
            let place = rest.parse::<u16>().map_err(|_| unknown())?;
            return place
                .checked_sub(1)
                .map(PointId::Device)
                .ok_or_else(unknown);
        }
        if let Some(rest) = s.strip_prefix('C') {
            let (code, dot) = rest.split_once('.').unwrap_or((rest, "O"));
            let dot = CodeDot::ALL
                .into_iter()
                .find(|d| d.name() == dot)
                .ok_or_else(unknown)?;
            let code = number(code)?;
            let known = (1..=Family::Dot420.code_count()).contains(&code);
            return known
                .then_some(PointId::Code {
                    family: Family::Dot420,
                    code,
                    dot,
                })
                .ok_or_else(unknown);
        }
        if let Some(rest) = s.strip_prefix('R') {
            let (segments, code) = rest.split_once('-').ok_or_else(unknown)?;
            let segments = number(segments)?;
            let family = Family::ALL
                .into_iter()
                .find(|f| matches!(f, Family::Ring(n) if u32::from(*n) == segments))
                .ok_or_else(unknown)?;
            let code = number(code)?;
            let known = (1..=family.code_count()).contains(&code);
            return known
                .then_some(PointId::Code {
                    family,
                    code,
                    dot: CodeDot::O,
                })
                .ok_or_else(unknown);
        }
        if let Some(rest) = s.strip_prefix('M') {
            let target = number(rest)?;
            let known = target <= LAST_TARGET;
            return known.then_some(PointId::Target(target)).ok_or_else(unknown);
        }
        Err(unknown())
    }
}

impl TryFrom<String> for PointId {
    type Error = UnknownLabel;

    fn try_from(s: String) -> Result<Self, Self::Error> {
        s.parse()
    }
}

impl From<PointId> for String {
    fn from(id: PointId) -> Self {
        id.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_read_as_they_are_written() {
        for label in ["C17.O", "C420.3", "R14-57", "R20-24793", "M5", "cross:1"] {
            assert_eq!(label.parse::<PointId>().unwrap().to_string(), label);
        }
        assert_eq!("C17".parse::<PointId>().unwrap().to_string(), "C17.O");
    }

    #[test]
    fn what_names_no_point_is_refused() {
        for label in [
            "",
            "C0",
            "C421",
            "C17.4",
            "R14-517",
            "R13-1",
            "R14",
            "Mx",
            "M4294967295",
            "cross:0",
            "Q1",
        ] {
            assert!(label.parse::<PointId>().is_err(), "{label}");
        }
    }
}
