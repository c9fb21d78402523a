//! Where along a ray the rays of other views pass: the places at which several of them do.

use std::collections::BTreeMap;

use super::problem::Member;

/// The part of a ray along which the ray of another dot is near, as distances from the camera, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    pub(super) from: f64,
    pub(super) to: f64,
    /// The dot of the other ray.
    pub(super) member: Member,
}

/// A place on a ray near which rays of several views pass.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MeetingPlace {
    /// Distance from the camera, mm.
    pub(super) along: f64,
    /// Other views that have a ray there.
    pub(super) views: usize,
    /// The dots of these rays, by view; more than one of a view where they compete.
    pub(super) members: Vec<Member>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Border {
    Begin,
    End,
}

/// The part of a ray where most views are together.
#[derive(Clone, Copy)]
struct Crowd {
    views: usize,
    from: f64,
    /// `None` while it lasts.
    to: Option<f64>,
}

/// The places along a ray where stretches of at least `least_views` views (1 or more) lie on top of each other: one of each unbroken
/// part of the ray where they do, there where most views have one. All dots that reach into that place belong to it.
///
/// Cost: that of sorting the stretches.
pub(super) fn meeting_places(stretches: &[Stretch], least_views: usize) -> Vec<MeetingPlace> {
    let mut borders: Vec<(f64, Border, usize)> = Vec::with_capacity(2 * stretches.len());
    for (index, stretch) in stretches.iter().enumerate() {
        borders.push((stretch.from, Border::Begin, index));
        borders.push((stretch.to, Border::End, index));
    }
    borders.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    // Dots of each view that are near the ray here.
    let mut here: BTreeMap<usize, usize> = BTreeMap::new();
    let mut crowd: Option<Crowd> = None;
    let mut places = Vec::new();
    for (along, border, index) in borders {
        let view = stretches[index].member.view;
        if border == Border::Begin {
            *here.entry(view).or_default() += 1;
            let views = here.len();
            if views >= least_views && crowd.is_none_or(|most| views > most.views) {
                crowd = Some(Crowd {
                    views,
                    from: along,
                    to: None,
                });
            }
            continue;
        }
        if let Some(dots) = here.get_mut(&view) {
            *dots -= 1;
            if *dots == 0 {
                here.remove(&view);
            }
        }
        let Some(most) = crowd.as_mut() else {
            continue;
        };
        if here.len() < most.views {
            most.to = most.to.or(Some(along));
        }
        if here.len() < least_views {
            places.extend(crowd.take().map(|crowd| place_of(stretches, crowd, along)));
        }
    }
    places
}

fn place_of(stretches: &[Stretch], crowd: Crowd, end: f64) -> MeetingPlace {
    let to = crowd.to.unwrap_or(end);
    let mut members: Vec<Member> = stretches
        .iter()
        .filter(|s| s.from < to && crowd.from < s.to || s.from == crowd.from)
        .map(|s| s.member)
        .collect();
    members.sort_unstable();
    MeetingPlace {
        along: (crowd.from + to) / 2.0,
        views: crowd.views,
        members,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stretch(from: f64, to: f64, view: usize, dot: usize) -> Stretch {
        Stretch {
            from,
            to,
            member: Member { view, dot },
        }
    }

    #[test]
    fn every_unbroken_part_with_enough_views_is_a_place_where_most_views_are() {
        let stretches = [
            stretch(10.0, 14.0, 1, 0),
            stretch(11.0, 13.0, 2, 0),
            stretch(12.0, 16.0, 3, 0),
            // Two dots of one view are one view.
            stretch(30.0, 32.0, 4, 0),
            stretch(31.0, 33.0, 4, 1),
            stretch(50.0, 52.0, 1, 5),
            stretch(51.0, 52.5, 4, 2),
        ];
        let places = meeting_places(&stretches, 2);
        let found: Vec<(f64, usize)> = places.iter().map(|p| (p.along, p.views)).collect();
        assert_eq!(found, [(12.5, 3), (51.5, 2)]);
        assert_eq!(
            places[0].members,
            [1, 2, 3].map(|view| Member { view, dot: 0 })
        );
        assert_eq!(meeting_places(&stretches, 3).len(), 1);
        assert_eq!(meeting_places(&stretches, 1).len(), 3);
        assert_eq!(meeting_places(&[], 1), []);
    }

    #[test]
    fn two_dots_of_a_view_at_one_place_are_both_told() {
        let stretches = [
            stretch(1.0, 5.0, 1, 0),
            stretch(2.0, 5.0, 2, 0),
            stretch(0.0, 6.0, 2, 1),
        ];
        let places = meeting_places(&stretches, 2);
        assert_eq!(places.len(), 1);
        assert_eq!(places[0].views, 2);
        let of_second = places[0].members.iter().filter(|m| m.view == 2);
        assert_eq!(of_second.count(), 2);
    }
}
