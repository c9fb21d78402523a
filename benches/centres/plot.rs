//! The plot of reached against possible.

use std::fmt::Write as _;

/// One case.
pub(crate) struct Point {
    /// Diameter of the dots, px.
    pub(crate) diameter: f64,
    /// What is possible, px.
    pub(crate) bound: f64,
    /// What was reached, px.
    pub(crate) rms: f64,
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 420.0;
const MARGIN: f64 = 56.0;
/// Decades of both axes, px.
const FIRST: i32 = -5;
const LAST: i32 = 0;

/// Both axes logarithmic; the diagonal is the bound.
pub(crate) fn svg(points: &[Point]) -> String {
    let share = |value: f64| (value.log10() - f64::from(FIRST)) / f64::from(LAST - FIRST);
    let x = |value: f64| MARGIN + share(value) * (WIDTH - 2.0 * MARGIN);
    let y = |value: f64| HEIGHT - MARGIN - share(value) * (HEIGHT - 2.0 * MARGIN);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\"><rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n"
    );
    let (low, high) = (10_f64.powi(FIRST), 10_f64.powi(LAST));
    let mut line = |from: [f64; 2], to: [f64; 2], colour: &str| {
        let _ = writeln!(
            out,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\"/>",
            from[0], from[1], to[0], to[1]
        );
    };
    for decade in FIRST..=LAST {
        let value = 10_f64.powi(decade);
        line([x(value), y(low)], [x(value), y(high)], "#ddd");
        line([x(low), y(value)], [x(high), y(value)], "#ddd");
    }
    line([x(low), y(low)], [x(high), y(high)], "#000");
    line([x(low), y(1.15 * low)], [x(high / 1.15), y(high)], "#c33");
    for decade in FIRST..=LAST {
        let value = 10_f64.powi(decade);
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{value}</text><text x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"end\">{value}</text>",
            x(value),
            y(low) + 16.0,
            x(low) - 6.0,
            y(value) + 4.0
        );
    }
    for point in points {
        // Small dots light, large ones dark.
        let shade = (200.0 - 100.0 * (point.diameter / 4.0).log10()).clamp(0.0, 200.0) as u8;
        let _ = writeln!(
            out,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2\" fill=\"rgb({shade},{shade},220)\"/>",
            x(point.bound),
            y(point.rms)
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">bound, px (black; 1.15 times: red)</text>\
         <text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">rms of the centre, px</text></svg>",
        0.5 * WIDTH,
        HEIGHT - 12.0,
        0.5 * HEIGHT
    );
    out
}
