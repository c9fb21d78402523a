//! The plot of what stays without a name against spacing and noise.

use std::fmt::Write as _;

/// One line of the plot: a noise.
pub(crate) struct Line {
    pub(crate) noise_px: f64,
    /// Spacing in dot diameters, share of the identifiable dots without the right label.
    pub(crate) points: Vec<[f64; 2]>,
}

const WIDTH: f64 = 620.0;
const HEIGHT: f64 = 400.0;
const MARGIN: f64 = 64.0;
/// Decades of the share that is missed.
const FIRST: i32 = -5;
const LAST: i32 = -1;
const COLOURS: [&str; 6] = [
    "#1b6ca8", "#2a9d8f", "#8ab17d", "#e9a23b", "#e76f51", "#9b2226",
];

/// Spacing along, missed share upwards (logarithmic; what missed nothing stands on the lowest line).
pub(crate) fn svg(lines: &[Line], spacings: &[f64]) -> String {
    let least = spacings.iter().copied().fold(f64::INFINITY, f64::min).ln();
    let most = spacings.iter().copied().fold(0.0, f64::max).ln();
    let x =
        |spacing: f64| MARGIN + (spacing.ln() - least) / (most - least) * (WIDTH - 2.5 * MARGIN);
    let y = |share: f64| {
        let decade = share.max(10_f64.powi(FIRST)).log10();
        let up = (decade - f64::from(FIRST)) / f64::from(LAST - FIRST);
        HEIGHT - MARGIN - up * (HEIGHT - 1.5 * MARGIN)
    };
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\"><rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n"
    );
    for decade in FIRST..=LAST {
        let at = y(10_f64.powi(decade));
        let share = 100.0 * 10_f64.powi(decade);
        let text = match decade {
            FIRST => "none".to_owned(),
            _ => format!("{share} %"),
        };
        let _ = writeln!(
            out,
            "<line x1=\"{:.1}\" y1=\"{at:.1}\" x2=\"{:.1}\" y2=\"{at:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
            x(least.exp()),
            x(most.exp()),
            MARGIN - 8.0,
            at + 4.0
        );
    }
    let limit = y(0.001);
    let _ = writeln!(
        out,
        "<line x1=\"{:.1}\" y1=\"{limit:.1}\" x2=\"{:.1}\" y2=\"{limit:.1}\" stroke=\"#c33\" stroke-dasharray=\"4 3\"/>",
        x(least.exp()),
        x(most.exp())
    );
    for spacing in spacings {
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{spacing}</text>",
            x(*spacing),
            HEIGHT - MARGIN + 18.0
        );
    }
    for (index, line) in lines.iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        let path: Vec<String> = line
            .points
            .iter()
            .map(|[spacing, share]| format!("{:.1},{:.1}", x(*spacing), y(*share)))
            .collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\">{} px</text>",
            path.join(" "),
            x(most.exp()) + 10.0,
            MARGIN + 16.0 * index as f64,
            line.noise_px
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">spacing of the targets, dot diameters</text>\
         <text transform=\"translate(14 {:.1}) rotate(-90)\" text-anchor=\"middle\">identifiable dots without the right label</text>\
         <text x=\"{:.1}\" y=\"{:.1}\">noise</text></svg>",
        0.5 * WIDTH,
        HEIGHT - 16.0,
        0.5 * HEIGHT,
        x(most.exp()) + 10.0,
        MARGIN - 20.0
    );
    out
}
