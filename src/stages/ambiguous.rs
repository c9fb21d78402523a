//! Groups of dots that several readings claim, written down for the operator.

use super::identify::Names;
use crate::matching;
use crate::network::{Agreement, AmbiguousGroup, PointId, ReadTarget, Reading};

impl Names<'_> {
    /// The questions that matching leaves, in the names of the network; `tracks` are those of its new targets.
    pub(super) fn ambiguous(
        &self,
        groups: &[matching::Group],
        tracks: &[PointId],
    ) -> Vec<AmbiguousGroup> {
        let readings = |group: &matching::Group| {
            let readings = group.readings.iter();
            readings
                .map(|reading| self.reading(reading, tracks))
                .collect()
        };
        let groups = groups.iter();
        groups
            .map(|group| AmbiguousGroup {
                readings: readings(group),
            })
            .collect()
    }

    fn reading(&self, reading: &matching::Reading, tracks: &[PointId]) -> Reading {
        let members = reading.members.iter();
        Reading {
            target: match reading.target {
                matching::ReadAs::NewTarget {
                    position,
                    covariance,
                } => ReadTarget::New {
                    position,
                    covariance,
                },
                matching::ReadAs::Known(known) => ReadTarget::Known(self.known_ids[known]),
                matching::ReadAs::Track(track) => ReadTarget::Known(tracks[track]),
            },
            dots: members
                .map(|member| {
                    let dot = self.views[member.view].dots[member.dot];
                    (self.images[member.view], dot)
                })
                .collect(),
            rays: agreement(reading.rays),
            shape: agreement(reading.shape),
            diameter_mm: reading.diameter_mm,
            log_likelihood: reading.log_likelihood,
        }
    }
}

fn agreement(of: matching::Agreement) -> Agreement {
    Agreement {
        chi_square: of.chi_square,
        freedom: of.freedom,
    }
}
