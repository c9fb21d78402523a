//! The evidence for each hypothesis, and what is left when readings compete for dots.

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::Dot420Settings;
use super::hypothesis::{Field, Hypothesis};
use super::outline::{Agreement, Outline, agreement, ovalness};
use super::surroundings::Surroundings;
use crate::targets::{CodeEvidence, CodeReading, Dot, DotIndex, Family, Rejected};

/// Refused readings are reported up to this multiple of the largest misfit allowed; beyond it they are mere chance.
const REPORTED_MISFIT_FACTOR: f64 = 1.5;
/// This many foreign dots too near to a code's dots make it part of a field of plain targets.
const FIELD_INTRUDERS: usize = 3;
/// Names of the dots in the operator's words.
const DOT_NAMES: [&str; 6] = ["O", "A", "B", "1", "2", "3"];

/// What [`read_dot420`] found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dot420Reading {
    /// The codes by number; their dots are O, A, B, 1, 2, 3.
    pub codes: Vec<CodeReading>,
    /// Groups of six dots that nearly made a code, by rows and columns.
    pub rejected: Vec<Rejected>,
}

/// A hypothesis with its verdict.
struct Judged {
    hypothesis: Hypothesis,
    /// What speaks against it without refusing it.
    doubts: Vec<String>,
    surroundings: Surroundings,
    /// Standardised misfit of the best reading that shares dots with it.
    second: Option<f64>,
}

enum Verdict {
    Read(Vec<String>),
    Refused(String),
    /// Too far from a code to be worth a word.
    Chance,
}

/// Finds and reads the six-dot codes among the dots of one picture.
///
/// `dots` in any order (pixels, y down), of any number and kind; dots that belong to no code are left alone. The time grows in
/// proportion to the number of dots. The result does not depend on the number of threads.
#[must_use]
pub fn read_dot420(dots: &[Dot], settings: &Dot420Settings) -> Dot420Reading {
    let field = Field::new(dots, settings);
    let judged: Vec<Vec<(Hypothesis, Verdict)>> = (0..dots.len())
        .into_par_iter()
        .map(|origin| {
            let judge = |h: Hypothesis| {
                let verdict = field.judge(&h);
                (h, verdict)
            };
            let verdicts = field.hypotheses(origin).into_iter().map(judge);
            verdicts
                .filter(|(_, v)| !matches!(v, Verdict::Chance))
                .collect()
        })
        .collect();
    let mut readings = Vec::new();
    let mut refused = Vec::new();
    for (hypothesis, verdict) in judged.into_iter().flatten() {
        match verdict {
            Verdict::Read(doubts) => readings.push(Judged::new(hypothesis, doubts)),
            Verdict::Refused(reason) => refused.push((hypothesis, reason)),
            Verdict::Chance => {}
        }
    }
    let (mut kept, beaten) = settle_shared_dots(readings, dots.len());
    doubt_repeated_numbers(&mut kept);
    look_round(&field, &mut kept);
    let rejected = rejections(&field, &kept, refused, beaten);
    kept.sort_by_key(|j| (j.hypothesis.id, j.hypothesis.slots));
    Dot420Reading {
        codes: kept.into_iter().map(Judged::into_reading).collect(),
        rejected,
    }
}

impl Field<'_> {
    fn judge(&self, hypothesis: &Hypothesis) -> Verdict {
        let plane = &hypothesis.plane;
        let settings = self.settings;
        let label = Family::Dot420.code_label(hypothesis.id);
        if plane.standardised > REPORTED_MISFIT_FACTOR * settings.refused_misfit {
            return Verdict::Chance;
        }
        if plane.depth_ratio() > settings.depth_ratio {
            return Verdict::Chance;
        }
        let (outlines, maps) = self.outlines_and_maps(hypothesis);
        match agreement(&outlines, &maps, 0.0, settings) {
            Agreement::Agree => {}
            Agreement::SizeOff(factor) => {
                return Verdict::Refused(format!(
                    "like {label}, but its dots are {factor:.2} times as large as the grid says"
                ));
            }
            Agreement::Differs(place) => {
                return Verdict::Refused(format!(
                    "like {label}, but dot {} has another size or shape than the plane of the code says",
                    DOT_NAMES[place]
                ));
            }
        }
        let misfit = format!(
            "the dots miss the grid by {:.2} px rms, {:.1} times what is expected",
            plane.rms_px, plane.standardised
        );
        if plane.standardised > settings.refused_misfit {
            return Verdict::Refused(format!("like {label}, but {misfit}"));
        }
        let contrasts = hypothesis.slots.map(|slot| self.dots[slot].contrast.abs());
        let brightest = contrasts.into_iter().fold(0.0, f64::max);
        let faintest = contrasts.into_iter().fold(f64::INFINITY, f64::min);
        if brightest > settings.contrast_ratio * faintest {
            return Verdict::Refused(format!(
                "like {label}, but its dots differ in contrast: {faintest:.0} to {brightest:.0}"
            ));
        }
        let mut doubts = Vec::new();
        match self.intruders(hypothesis) {
            0 => {}
            few if few < FIELD_INTRUDERS => doubts.push(format!(
                "{few} foreign dot(s) of the same plane within {} pitches of its dots",
                settings.clear_pitches
            )),
            many => {
                return Verdict::Refused(format!(
                    "like {label}, but part of a field: {many} foreign dots within {} pitches of its dots",
                    settings.clear_pitches
                ));
            }
        }
        let ovalness = ovalness(&outlines, &maps, settings).unwrap_or(f64::INFINITY);
        if ovalness > settings.refused_ovalness {
            return Verdict::Refused(format!(
                "like {label}, but its dots would not be round: their axes differ by {:.0} %",
                100.0 * ovalness
            ));
        }
        if plane.standardised > settings.certain_misfit {
            doubts.push(misfit);
        }
        if doubts.len() > 1 {
            return Verdict::Refused(format!("like {label}, but {}", doubts.join("; ")));
        }
        Verdict::Read(doubts)
    }

    /// The outlines of the six dots and the local maps that the plane predicts there.
    fn outlines_and_maps(&self, hypothesis: &Hypothesis) -> (Vec<Outline>, [Matrix2<f64>; 6]) {
        let slots = hypothesis.slots.iter();
        let outlines = slots.filter_map(|&slot| self.outlines[slot]).collect();
        let maps = hypothesis.grid.map(|[x, y]| {
            let place = Vector2::new(f64::from(x), f64::from(y));
            hypothesis.plane.px_from_pitches(place)
        });
        (outlines, maps)
    }

    /// How many foreign dots stand too near to one of the six and look as if they lay on the code's plane.
    fn intruders(&self, hypothesis: &Hypothesis) -> usize {
        let mut found = Vec::new();
        for (slot, place) in hypothesis.slots.iter().zip(hypothesis.grid) {
            let centre = Vector2::new(f64::from(place[0]), f64::from(place[1]));
            let map = hypothesis.plane.px_from_pitches(centre);
            let reach_px = self.settings.clear_pitches * map.norm();
            let near = self
                .index
                .within(self.dots, self.dots[*slot].centre_px, reach_px);
            found.extend(near.into_iter().filter(|other| {
                !hypothesis.slots.contains(other) && self.is_near(hypothesis, *other, centre)
            }));
        }
        found.sort_unstable();
        found.dedup();
        found.len()
    }

    fn is_near(&self, hypothesis: &Hypothesis, other: usize, centre: Vector2<f64>) -> bool {
        let Some(outline) = self.outlines[other] else {
            return false;
        };
        let place = hypothesis.plane.grid_from_px(self.dots[other].centre_px);
        place.is_some_and(|place| {
            let map = hypothesis.plane.px_from_pitches(place);
            (place - centre).norm() < self.settings.clear_pitches
                && agreement(&[outline], &[map], 0.0, self.settings) == Agreement::Agree
        })
    }
}

/// Keeps the best-fitting reading of those that share a dot; returns the others apart, each with the winner's number.
fn settle_shared_dots(
    mut readings: Vec<Judged>,
    dot_count: usize,
) -> (Vec<Judged>, Vec<(Hypothesis, String)>) {
    // Readings without a doubt come first, then the better fit; slots settle what is equal to the last digit.
    readings.sort_by(|a, b| {
        let key = |j: &Judged| (!j.doubts.is_empty(), j.hypothesis.slots);
        let ((a_doubt, a_slots), (b_doubt, b_slots)) = (key(a), key(b));
        a_doubt
            .cmp(&b_doubt)
            .then(
                a.hypothesis
                    .plane
                    .standardised
                    .total_cmp(&b.hypothesis.plane.standardised),
            )
            .then(a_slots.cmp(&b_slots))
    });
    let mut owner: Vec<Option<usize>> = vec![None; dot_count];
    let mut kept: Vec<Judged> = Vec::new();
    let mut beaten = Vec::new();
    for reading in readings {
        let slots = reading.hypothesis.slots;
        let mut winners: Vec<usize> = slots.iter().filter_map(|&slot| owner[slot]).collect();
        winners.sort_unstable();
        winners.dedup();
        if winners.is_empty() {
            for slot in slots {
                owner[slot] = Some(kept.len());
            }
            kept.push(reading);
            continue;
        }
        let label = Family::Dot420.code_label(reading.hypothesis.id);
        let mut better = Vec::new();
        for winner in winners {
            better.push(Family::Dot420.code_label(kept[winner].hypothesis.id));
            let second = kept[winner].second.unwrap_or(f64::INFINITY);
            kept[winner].second = Some(second.min(reading.hypothesis.plane.standardised));
            if reading.doubts.is_empty() {
                let doubt = format!("some of its dots fit {label} too");
                kept[winner].doubts.push(doubt);
            }
        }
        let reason = format!(
            "{label} shares dots with {}, which fits better",
            better.join(", ")
        );
        beaten.push((reading.hypothesis, reason));
    }
    (kept, beaten)
}

fn doubt_repeated_numbers(kept: &mut [Judged]) {
    let mut ids: Vec<u32> = kept.iter().map(|j| j.hypothesis.id).collect();
    ids.sort_unstable();
    for judged in kept {
        let id = judged.hypothesis.id;
        let first = ids.partition_point(|&other| other < id);
        let times = ids.partition_point(|&other| other <= id) - first;
        if times > 1 {
            let doubt = format!("this number is read {times} times in the picture");
            judged.doubts.push(doubt);
        }
    }
}

/// Counts what stands round each reading, and doubts those that a plain target may have completed.
fn look_round(field: &Field<'_>, kept: &mut [Judged]) {
    let mut taken = vec![false; field.dots.len()];
    for slot in kept.iter().flat_map(|j| j.hypothesis.slots) {
        taken[slot] = true;
    }
    for judged in kept {
        judged.surroundings = field.surroundings(&judged.hypothesis, &taken);
        let doubt = judged.surroundings.doubt(field.settings.rival_chance);
        judged.doubts.extend(doubt);
    }
}

/// The refused groups worth telling: one for each set of dots, the best fit, and none whose dots a kept code explains.
fn rejections(
    field: &Field<'_>,
    kept: &[Judged],
    refused: Vec<(Hypothesis, String)>,
    beaten: Vec<(Hypothesis, String)>,
) -> Vec<Rejected> {
    let mut taken = vec![false; field.dots.len()];
    for slot in kept.iter().flat_map(|j| j.hypothesis.slots) {
        taken[slot] = true;
    }
    let mut refused = refused;
    refused.sort_by(|(a, _), (b, _)| {
        let order = a.plane.standardised.total_cmp(&b.plane.standardised);
        order.then(a.slots.cmp(&b.slots))
    });
    let mut told = beaten;
    for (hypothesis, reason) in refused {
        if hypothesis.slots.iter().any(|&slot| taken[slot]) {
            continue;
        }
        for slot in hypothesis.slots {
            taken[slot] = true;
        }
        told.push((hypothesis, reason));
    }
    let mut rejected: Vec<Rejected> = told
        .into_iter()
        .map(|(hypothesis, reason)| {
            let places = hypothesis.slots.map(|slot| field.dots[slot].centre_px);
            Rejected {
                place_px: places.iter().sum::<Vector2<f64>>() / places.len() as f64,
                reason,
            }
        })
        .collect();
    rejected.sort_by(|a, b| {
        let rows = a.place_px.y.total_cmp(&b.place_px.y);
        rows.then(a.place_px.x.total_cmp(&b.place_px.x))
            .then_with(|| a.reason.cmp(&b.reason))
    });
    rejected
}

impl Judged {
    fn new(hypothesis: Hypothesis, doubts: Vec<String>) -> Self {
        Self {
            hypothesis,
            doubts,
            surroundings: Surroundings::default(),
            second: None,
        }
    }

    fn into_reading(self) -> CodeReading {
        let dots = self.hypothesis.slots.map(|slot| DotIndex(slot as u32));
        let fit = &self.hypothesis.plane;
        CodeReading {
            family: Family::Dot420,
            id: self.hypothesis.id,
            dots: dots.to_vec(),
            misfit: fit.rms_px,
            doubt: (!self.doubts.is_empty()).then(|| self.doubts.join("; ")),
            evidence: CodeEvidence {
                fit: fit.standardised,
                margin: self.second.map(|second| second / fit.standardised.max(0.1)),
                rivals: self.surroundings.rivals,
                // Infinite odds would not survive the project file.
                rival_odds: self.surroundings.chance.min(1e9),
                foreign_dots: self.surroundings.foreign,
                departing_segments: 0,
            },
        }
    }
}
