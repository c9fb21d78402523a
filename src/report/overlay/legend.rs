//! What the colours of an overlay mean, and how many there are of each.

use nalgebra::Vector2;

use super::canvas::{Canvas, Colour, Letters, Outline};
use super::colours;
use super::reasons::ReasonKind;
use super::room::Room;
use crate::targets::Detections;

/// One line of the legend.
struct Entry {
    sign: Sign,
    colour: Colour,
    words: String,
}

enum Sign {
    Ellipse,
    Cross,
    /// Further to the right: a part of the line above.
    None,
}

/// Kinds of refusal that are listed; the others are summed.
const KINDS: usize = 12;
const PAD_PX: usize = 8;

/// The legend in the corner where it covers least of what is `drawn`; its room is taken.
pub(super) fn draw_legend(
    canvas: &mut Canvas,
    room: &mut Room,
    drawn: &Room,
    detections: &Detections,
    kinds: &[ReasonKind],
    letters: Letters,
) {
    let entries = entries(detections, kinds);
    let lines: Vec<String> = entries.iter().map(|entry| entry.words.clone()).collect();
    let sign = letters.height();
    let text = letters.size(&lines);
    let size = [text[0] + sign + 3 * PAD_PX, text[1] + 2 * PAD_PX];
    let corner = emptiest_corner(canvas.size(), size, drawn);
    room.take(corner, size);
    canvas.shade(corner, size);
    for (row, entry) in entries.into_iter().enumerate() {
        let top = corner[1] + PAD_PX + row * letters.height();
        let left = corner[0] + PAD_PX;
        let half = 0.5 * sign as f64;
        let middle = Vector2::new(left as f64 + half, top as f64 + half);
        match entry.sign {
            Sign::Ellipse => {
                let outline = Outline {
                    centre: middle,
                    major: 1.1 * half,
                    minor: 0.8 * half,
                    angle: 0.0,
                };
                canvas.ellipse(&outline, 2.0, entry.colour);
            }
            Sign::Cross => canvas.cross(middle, 0.4 * half, 1.5, entry.colour),
            Sign::None => {}
        }
        canvas.text(
            [left + sign + PAD_PX, top],
            &[entry.words],
            letters,
            entry.colour,
        );
    }
}

fn entries(detections: &Detections, kinds: &[ReasonKind]) -> Vec<Entry> {
    let counted = |count: usize, one: &str, many: &str| {
        format!("{count} {}", if count == 1 { one } else { many })
    };
    let doubtful = detections.codes.iter().filter(|c| c.doubt.is_some());
    let doubtful = doubtful.count();
    let mut of_codes = vec![false; detections.dots.len()];
    for dot in detections.codes.iter().flat_map(|code| &code.dots) {
        if let Some(of_code) = of_codes.get_mut(dot.slot()) {
            *of_code = true;
        }
    }
    let plain = of_codes.iter().filter(|of_code| !**of_code).count();
    let certain = detections.codes.len() - doubtful;
    let ellipse = |colour, words| Entry {
        sign: Sign::Ellipse,
        colour,
        words,
    };
    let mut entries = vec![
        ellipse(colours::CODE, counted(certain, "code", "codes")),
        ellipse(
            colours::DOUBT,
            counted(doubtful, "doubtful code", "doubtful codes"),
        ),
        ellipse(
            colours::PLAIN,
            counted(plain, "dot without a code", "dots without a code"),
        ),
        Entry {
            sign: Sign::Cross,
            colour: colours::REFUSED,
            words: counted(detections.rejected.len(), "place refused", "places refused"),
        },
    ];
    let further = |words| Entry {
        sign: Sign::None,
        colour: colours::REFUSED_TEXT,
        words,
    };
    entries.extend(
        kinds
            .iter()
            .take(KINDS)
            .map(|kind| further(format!("{} {:4} {}", kind.letter, kind.count, kind.words))),
    );
    if kinds.len() > KINDS {
        let others: usize = kinds[KINDS..].iter().map(|kind| kind.count).sum();
        entries.push(further(format!("  {others:4} for other reasons")));
    }
    entries
}

/// The corner of the picture in which a box covers the fewest taken cells, the top left one first.
fn emptiest_corner(picture: [usize; 2], size: [usize; 2], room: &Room) -> [usize; 2] {
    let right = picture[0].saturating_sub(size[0]);
    let bottom = picture[1].saturating_sub(size[1]);
    [[0, 0], [right, 0], [0, bottom], [right, bottom]]
        .into_iter()
        .min_by_key(|&corner| room.taken_in(corner, size))
        .unwrap_or([0, 0])
}
