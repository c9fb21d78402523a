//! What the colours, shapes and sizes on the canvas mean, with numbers and units.

use egui::Align2;
use egui::Color32;
use egui::FontId;
use egui::Pos2;
use egui::Rect;
use egui::Sense;
use egui::Stroke;
use egui::Vec2;
use egui::WidgetInfo;

use super::colour::viridis;
use super::highlight::Highlight;
use super::highlight::selected_colour;
use super::options::Colouring;
use super::options::DisplayOptions;
use super::scene::Scene;
use crate::network::PointKind;
use crate::ui::format;
use crate::ui::theme;

const ROW: f32 = 17.0;
const WIDTH: f32 = 190.0;
const SYMBOL: f32 = 22.0;

/// A plate behind the legend that were wider than this part of the canvas would hide the network.
const MOST_OF_CANVAS: f32 = 0.5;

/// What stands before the text.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Symbol {
    Disc(Color32),
    Diamond(Color32),
    Triangle(Color32),
    Line(Color32),
    Gradient,
    Nothing,
}

struct Row {
    symbol: Symbol,
    text: String,
}

impl Row {
    fn new(symbol: Symbol, text: impl Into<String>) -> Self {
        Self {
            symbol,
            text: text.into(),
        }
    }
}

/// How large an ellipsoid is drawn.
pub(super) fn exaggeration_text(factor: f64) -> String {
    format!("ellipsoids: 1 sigma x {factor}")
}

fn rows(
    scene: &Scene,
    highlight: &Highlight,
    options: &DisplayOptions,
    theme: egui::Theme,
) -> Vec<Row> {
    let palette = &scene.palette;
    let mut rows = Vec::new();
    match (options.colouring, scene.scale) {
        (Colouring::Kind, _) => rows.extend(scene.kinds.iter().map(|kind| match kind {
            PointKind::Code => Row::new(Symbol::Disc(palette.kind(*kind)), "coded target"),
            PointKind::Target => Row::new(Symbol::Disc(palette.kind(*kind)), "plain target"),
            PointKind::Cross => Row::new(Symbol::Diamond(palette.kind(*kind)), "reference cross"),
        })),
        (Colouring::Precision, None) => {
            rows.push(Row::new(Symbol::Nothing, "sigma: not adjusted yet"));
        }
        (Colouring::Rays, None) => {}
        (colouring, Some(scale)) => {
            let (title, number): (_, fn(f64) -> String) = match colouring {
                Colouring::Precision => {
                    ("mean sigma of x, y, z", |value| format::sigma(value, "mm"))
                }
                Colouring::Rays | Colouring::Kind => {
                    ("rays of a point", |value| format!("{value:.0} rays"))
                }
            };
            rows.push(Row::new(Symbol::Nothing, title));
            rows.push(Row::new(
                Symbol::Gradient,
                format!("{} to {}", number(scale.low), number(scale.high)),
            ));
            if number(scale.largest) != number(scale.high) {
                let text = format!("the brightest up to {}", number(scale.largest));
                rows.push(Row::new(Symbol::Nothing, text));
            }
        }
    }
    if scene.unknown > 0 {
        rows.push(Row::new(
            Symbol::Disc(palette.neutral),
            format!("not known: {} points", scene.unknown),
        ));
    }
    if scene.control > 0 {
        rows.push(Row::new(
            Symbol::Triangle(palette.text),
            "known coordinates",
        ));
    }
    if let Some(factor) = scene.exaggeration {
        rows.push(Row::new(Symbol::Nothing, exaggeration_text(factor)));
    }
    if !scene.bars.is_empty() {
        rows.push(Row::new(Symbol::Line(palette.bar), "scale bar"));
    }
    if options.connection_order.is_shown() {
        rows.push(Row::new(Symbol::Line(palette.order), "order of connection"));
    }
    if highlight.used_rays > 0 {
        let text = format!("rays used: {}", highlight.used_rays);
        rows.push(Row::new(Symbol::Line(selected_colour(theme)), text));
    }
    if highlight.rejected_rays > 0 {
        let text = format!("rays rejected: {}", highlight.rejected_rays);
        rows.push(Row::new(Symbol::Line(theme::REJECTED), text));
    }
    rows
}

/// Draws the legend into the lower left corner of the canvas.
pub(super) fn draw(
    ui: &egui::Ui,
    canvas: Rect,
    scene: &Scene,
    highlight: &Highlight,
    options: &DisplayOptions,
    theme: egui::Theme,
) {
    let rows = rows(scene, highlight, options, theme);
    let gradients = rows
        .iter()
        .filter(|row| row.symbol == Symbol::Gradient)
        .count() as f32;
    let size = Vec2::new(WIDTH, (rows.len() as f32 + gradients) * ROW + 8.0);
    let rect = Rect::from_min_size(canvas.left_bottom() + Vec2::new(6.0, -6.0 - size.y), size);
    if rows.is_empty() || !canvas.contains_rect(rect) {
        return;
    }
    let painter = ui.painter_at(canvas);
    // On a small canvas the network is seen through the legend.
    if rect.width() < MOST_OF_CANVAS * canvas.width() {
        painter.rect_filled(rect, 4.0, scene.palette.canvas.gamma_multiply(0.85));
    }
    let mut top = rect.min + Vec2::new(6.0, 4.0);
    for (place, row) in rows.iter().enumerate() {
        if row.symbol == Symbol::Gradient {
            draw_gradient(
                &painter,
                Rect::from_min_size(
                    top + Vec2::new(0.0, 3.0),
                    Vec2::new(WIDTH - 12.0, ROW - 5.0),
                ),
            );
            top.y += ROW;
        }
        let at = top + Vec2::new(SYMBOL / 2.0 - 2.0, ROW / 2.0);
        draw_symbol(&painter, at, row.symbol);
        let indent = if matches!(row.symbol, Symbol::Nothing | Symbol::Gradient) {
            0.0
        } else {
            SYMBOL
        };
        let place_of_text = Pos2::new(top.x + indent, at.y);
        painter.text(
            place_of_text,
            Align2::LEFT_CENTER,
            &row.text,
            FontId::proportional(12.0),
            scene.palette.text,
        );
        let row_rect = Rect::from_min_size(top, Vec2::new(WIDTH - 12.0, ROW));
        ui.interact(
            row_rect,
            ui.scope_id().with(("legend", place)),
            Sense::hover(),
        )
        .widget_info(|| WidgetInfo::labeled(egui::Role::Label, true, &row.text));
        top.y += ROW;
    }
}

fn draw_symbol(painter: &egui::Painter, at: Pos2, symbol: Symbol) {
    match symbol {
        Symbol::Disc(colour) => {
            painter.circle_filled(at, 4.0, colour);
        }
        Symbol::Diamond(colour) => {
            let corners = [(0.0, -5.5), (5.5, 0.0), (0.0, 5.5), (-5.5, 0.0)]
                .map(|(x, y)| at + Vec2::new(x, y));
            painter.add(egui::Shape::convex_polygon(
                corners.to_vec(),
                colour,
                Stroke::NONE,
            ));
        }
        Symbol::Triangle(colour) => {
            let corners = [(0.0, -5.5), (5.0, 3.0), (-5.0, 3.0)].map(|(x, y)| at + Vec2::new(x, y));
            painter.add(egui::Shape::convex_polygon(
                corners.to_vec(),
                colour,
                Stroke::NONE,
            ));
        }
        Symbol::Line(colour) => {
            let half = Vec2::new(8.0, 0.0);
            painter.line_segment([at - half, at + half], Stroke::new(2.0, colour));
        }
        Symbol::Gradient | Symbol::Nothing => {}
    }
}

fn draw_gradient(painter: &egui::Painter, rect: Rect) {
    const STEPS: u32 = 24;
    let mut mesh = egui::Mesh::default();
    for step in 0..=STEPS {
        let part = step as f32 / STEPS as f32;
        let x = rect.left() + part * rect.width();
        let colour = viridis(part.into());
        mesh.colored_vertex(Pos2::new(x, rect.top()), colour);
        mesh.colored_vertex(Pos2::new(x, rect.bottom()), colour);
        if step > 0 {
            let last = 2 * step;
            mesh.add_triangle(last - 2, last - 1, last);
            mesh.add_triangle(last - 1, last, last + 1);
        }
    }
    painter.add(mesh);
}
