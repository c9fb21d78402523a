//! From what lies where to names, and to what is left on both sides, each with its reason.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::Serialize;

use super::assignment::{Assignment, RivalPlace, Verdict};
use super::lists::{Lists, Meaning, Pair};
use super::places::{Near, Places};
use super::{ExistingNames, Naming, Way};
use crate::geometry::Scale;
use crate::network::{PointId, ScaleSource};
use crate::report::compare::{Counterpart, Difference, agreement, difference};

/// A known place and a target that cannot be told from another.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ambiguity {
    /// Name of the reference point.
    pub reference: String,
    /// Label of the nearest point.
    pub point: String,
    /// How far it lies from the known place, mm.
    pub distance_mm: f64,
    /// What is too near to be told apart.
    pub rival: Rival,
}

/// The other candidate.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Rival {
    /// Another point at the same known place.
    Point {
        /// Its label.
        label: String,
        /// Its distance from the known place, mm.
        distance_mm: f64,
    },
    /// Another known place at the same point.
    Reference {
        /// Its name.
        label: String,
        /// Its distance from the point, mm.
        distance_mm: f64,
    },
}

/// A reference point that gave no name.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReferenceLeft {
    /// Its name.
    pub reference: String,
    /// Why.
    #[serde(flatten)]
    pub why: WhyLeft,
}

/// Why a reference point gave no name; its `Display` is the end of a line that begins with the name.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "reason", rename_all = "kebab-case")]
pub enum WhyLeft {
    /// A coordinate is unknown.
    NoPlace,
    /// Its name is the label of a dot that was not adjusted.
    NotMeasured,
    /// It has no name to give.
    NoName {
        /// The target that lies there.
        target: String,
    },
    /// Its name is `M` and a number.
    NumberOfTarget {
        /// The target that lies there.
        target: String,
    },
    /// A dot of a code or of the cross lies there, which keeps its label.
    OnDot {
        /// The dot.
        label: String,
        /// How far, mm.
        distance_mm: f64,
    },
    /// The target that lies there has another name, which stays.
    OtherName {
        /// That name.
        label: String,
        /// How far, mm.
        distance_mm: f64,
    },
    /// Another target has this name, which stays.
    NameOfOther {
        /// The target that lies there.
        target: String,
    },
    /// The transformation is not known well enough there.
    OutOfReach {
        /// The nearest target.
        target: String,
        /// How far, mm.
        distance_mm: f64,
    },
    /// Nothing lies there.
    NotFound {
        /// The nearest point.
        nearest: Option<String>,
        /// How far, mm.
        distance_mm: Option<f64>,
    },
}

impl fmt::Display for WhyLeft {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPlace => f.write_str("has fewer than three coordinates"),
            Self::NotMeasured => f.write_str("is no adjusted point"),
            Self::NoName { target } => write!(f, "has no name to give {target}"),
            Self::NumberOfTarget { target } => {
                write!(
                    f,
                    "is a label as any target gets it, no name to give {target}"
                )
            }
            Self::OnDot { label, distance_mm } => {
                write!(
                    f,
                    "lies at {label}, which keeps its label ({distance_mm:.3} mm)"
                )
            }
            Self::OtherName { label, distance_mm } => {
                write!(
                    f,
                    "lies at '{label}', which keeps its name ({distance_mm:.3} mm)"
                )
            }
            Self::NameOfOther { target } => {
                write!(
                    f,
                    "is the name of another target than {target}, which lies there"
                )
            }
            Self::OutOfReach {
                target,
                distance_mm,
            } => write!(
                f,
                "too far from the points in common to give {target} the name ({distance_mm:.3} mm)"
            ),
            Self::NotFound {
                nearest: Some(nearest),
                distance_mm: Some(distance_mm),
            } => write!(f, "nothing lies there ({nearest} in {distance_mm:.3} mm)"),
            Self::NotFound { .. } => f.write_str("nothing lies there"),
        }
    }
}

/// A plain target at no known place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetLeft {
    /// Its label.
    pub target: String,
    /// The nearest reference point.
    pub nearest: Option<String>,
    /// How far, mm.
    pub distance_mm: Option<f64>,
}

/// What becomes of a known place.
enum Fate {
    /// Its name is given to a target.
    Given(Pair, u32),
    /// The target has this name already.
    HadBefore,
    Ambiguous(Ambiguity),
    Left(WhyLeft),
}

/// Names, and what is left.
pub(super) fn naming(
    lists: &Lists<'_>,
    assignment: &Assignment,
    way: Way,
    scale_from: ScaleSource,
) -> Naming {
    let fit = &assignment.fit;
    let differences = |pairs: &[Pair], by| -> Vec<Difference> {
        let of = |pair: &Pair| {
            let point = &lists.points[pair.point];
            difference(lists.network, point, lists.row(pair.known), fit, by)
        };
        pairs.iter().map(of).collect()
    };
    let sorted = sorted(lists, assignment);
    let named = differences(&sorted.given, Counterpart::Place);
    Naming {
        way,
        within_mm: lists.within,
        with_scale: lists.settings.scale == Scale::Free,
        scale_from,
        scale: fit.scale,
        rotation: std::array::from_fn(|r| std::array::from_fn(|c| fit.rotation.matrix()[(r, c)])),
        translation_mm: fit.translation.into(),
        fit: agreement(&differences(&assignment.pairs, Counterpart::Place)),
        named: agreement(&named),
        named_before: sorted.named_before,
        labels_off: differences(&labels_off(lists, assignment), Counterpart::Label),
        differences: named,
        targets_left: targets_left(lists, assignment),
        ambiguous: sorted.ambiguous,
        reference_left: sorted.left,
        names: sorted.names,
    }
}

#[derive(Default)]
struct Sorted {
    given: Vec<Pair>,
    names: BTreeMap<u32, String>,
    named_before: usize,
    ambiguous: Vec<Ambiguity>,
    left: Vec<ReferenceLeft>,
}

fn sorted(lists: &Lists<'_>, assignment: &Assignment) -> Sorted {
    let tied: BTreeSet<usize> = lists.tied().map(|pair| pair.known).collect();
    let mut sorted = Sorted::default();
    let mut known = lists.known.iter().enumerate().peekable();
    for (row, point) in lists.reference.iter().enumerate() {
        let reference = point.name.clone();
        let mut leave = |reference, why| sorted.left.push(ReferenceLeft { reference, why });
        let Some((index, _)) = known.next_if(|(_, known)| known.row == row) else {
            leave(reference, WhyLeft::NoPlace);
            continue;
        };
        if tied.contains(&index) {
            continue;
        }
        match fate(lists, assignment, index) {
            Fate::Left(why) => leave(reference, why),
            Fate::Ambiguous(ambiguity) => sorted.ambiguous.push(ambiguity),
            Fate::HadBefore => sorted.named_before += 1,
            Fate::Given(pair, target) => {
                sorted.given.push(pair);
                let name = point.label.clone().unwrap_or(reference);
                sorted.names.insert(target, name.trim().to_owned());
            }
        }
    }
    // Those that are tied to their target have its name.
    let is_named = |pair: &&Pair| matches!(lists.known[pair.known].meaning, Meaning::Target(_));
    sorted.named_before += lists.tied().filter(is_named).count();
    sorted
}

fn fate(lists: &Lists<'_>, assignment: &Assignment, known: usize) -> Fate {
    let meaning = lists.known[known].meaning;
    if let Meaning::Dot(_) = meaning {
        return Fate::Left(WhyLeft::NotMeasured);
    }
    let near = match assignment.verdicts[known] {
        Verdict::Certain(near) => near,
        Verdict::Ambiguous { point, rival } => {
            return Fate::Ambiguous(ambiguity(lists, known, point, rival));
        }
        Verdict::OutOfReach(near) => {
            return Fate::Left(WhyLeft::OutOfReach {
                target: lists.label(near.index),
                distance_mm: near.distance,
            });
        }
        Verdict::Nothing(nearest) => {
            return Fate::Left(WhyLeft::NotFound {
                nearest: nearest.map(|near| lists.label(near.index)),
                distance_mm: nearest.map(|near| near.distance),
            });
        }
    };
    let (label, distance_mm) = (lists.label(near.index), near.distance);
    let PointId::Target(number) = lists.points[near.index].id else {
        return Fate::Left(WhyLeft::OnDot { label, distance_mm });
    };
    let pair = Pair {
        known,
        point: near.index,
    };
    let stays = lists.settings.existing == ExistingNames::Stay;
    let has_name = lists.network.names.contains_key(&number);
    match meaning {
        Meaning::Unnamed => Fate::Left(WhyLeft::NoName { target: label }),
        Meaning::Number(own) if own == number && !has_name => Fate::HadBefore,
        Meaning::Number(_) => Fate::Left(WhyLeft::NumberOfTarget { target: label }),
        Meaning::Target(own) if own == number => Fate::HadBefore,
        _ if stays && has_name => Fate::Left(WhyLeft::OtherName { label, distance_mm }),
        Meaning::Target(_) if stays => Fate::Left(WhyLeft::NameOfOther { target: label }),
        Meaning::Target(_) | Meaning::Free | Meaning::Dot(_) => Fate::Given(pair, number),
    }
}

fn ambiguity(lists: &Lists<'_>, known: usize, point: Near, rival: RivalPlace) -> Ambiguity {
    Ambiguity {
        reference: lists.row(known).name.clone(),
        point: lists.label(point.index),
        distance_mm: point.distance,
        rival: match rival {
            RivalPlace::Point(near) => Rival::Point {
                label: lists.label(near.index),
                distance_mm: near.distance,
            },
            RivalPlace::Known(near) => Rival::Reference {
                label: lists.row(near.index).name.clone(),
                distance_mm: near.distance,
            },
        },
    }
}

/// Labels that stay and do not lie within the distance.
fn labels_off(lists: &Lists<'_>, assignment: &Assignment) -> Vec<Pair> {
    let fitted: BTreeSet<&Pair> = assignment.pairs.iter().collect();
    let off = lists.tied().filter(|pair| !fitted.contains(pair));
    off.copied().collect()
}

/// Plain targets that lie at no known place.
fn targets_left(lists: &Lists<'_>, assignment: &Assignment) -> Vec<TargetLeft> {
    let tied: BTreeSet<usize> = lists.tied().map(|pair| pair.point).collect();
    let known = Places::new(&lists.known_places);
    let mut left = Vec::new();
    for (index, point) in lists.points.iter().enumerate() {
        let [nearest, _] = known.two_nearest(&assignment.moved[index]);
        let is_at_place = nearest.is_some_and(|near| near.distance <= lists.within);
        if point.id.code().is_some()
            || matches!(point.id, PointId::Device(_))
            || tied.contains(&index)
            || is_at_place
        {
            continue;
        }
        left.push(TargetLeft {
            target: lists.label(index),
            nearest: nearest.map(|near| lists.row(near.index).name.clone()),
            distance_mm: nearest.map(|near| near.distance),
        });
    }
    left
}
