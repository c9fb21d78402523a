//! One image: its grey picture with everything that is known of it, and the tools to mend it by hand.
//!
//! The picture is drawn by the graphics card from tiles with mip levels ([`tiles`]), window and level in the shader. All
//! that is drawn over it goes through one transform ([`transform`]) and is gathered once per document ([`marks`]).
//! Predicted places and epipolar lines come from the image's station and camera ([`prediction`]).
//!
//! Keys, while the pointer is over the image: `F` fit, `1` one to one, `Z` loupe, `W` + drag window and level, `0`
//! automatic contrast, `L` label, `X` reject, `R` restore, `Delete` take the label away, `A` measure, `N` number of
//! the selected code.

mod hover;
mod labelling;
mod marks;
mod overlay;
mod prediction;
#[cfg(test)]
mod tests;
mod tiles;
mod transform;

use std::sync::Arc;

use eframe::egui_wgpu;
use egui::{Color32, Key, Modifiers, PointerButton, Pos2, Rect, Response, Sense, Stroke, Ui, vec2};
use nalgebra::Vector2;

use crate::imaging::GreyImage;
use crate::network::{ImageEntry, ImageId, Network, PointId, Stage};
use crate::project::edit::Edit;
use crate::targets::{Dot, DotIndex, MeasureAtSettings, centre_by_hand, measure_at};
use crate::ui::action::{Action, RunRequest, Selection};
use crate::ui::context::ViewContext;
use crate::ui::pictures::PictureState;

use hover::Hovered;
use labelling::{Choice, Entered, LabelPopup, NumberPopup, Subject};
use marks::{Marks, MarksCache};
use overlay::Easel;
use tiles::PictureCallback;
use transform::Sight;

pub use labelling::{LabelCandidate, filtered, new_target, rank_labels};
pub use marks::DotClass;
pub use overlay::{Overlay, Overlays};
pub use prediction::{Facing, Predicted, missed_targets};
pub use tiles::{GreyWindow, install};
pub use transform::{PixelRect, ScreenFromImage};

/// Magnification of the loupe, screen points per pixel.
const LOUPE_SCALE: f64 = 16.0;
/// Side of the loupe, points.
const LOUPE_SIDE: f32 = 220.0;

/// What a click does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tool {
    /// Selects.
    Look,
    /// Measures a dot.
    Measure,
}

#[derive(Clone, Debug)]
enum Popup {
    Label(LabelPopup),
    Number(NumberPopup),
}

/// An open image.
pub struct ImageView {
    /// The image.
    pub image: ImageId,
    /// What is drawn over it.
    pub overlays: Overlays,
    /// Residual vectors are drawn so many times as long as they are.
    pub exaggeration: f64,
    /// Whether the loupe stays open.
    loupe: Loupe,
    sight: Sight,
    window: Option<GreyWindow>,
    tool: Tool,
    popup: Option<Popup>,
    marks: MarksCache,
    epipolar: EpipolarCache,
    status: Option<String>,
    /// Tells this view from others in the renderer.
    view: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loupe {
    Closed,
    Open,
}

/// Lines of the last selection.
#[derive(Default)]
struct EpipolarCache {
    of: Option<(Selection, Arc<Marks>)>,
    lines: Vec<Vec<Vector2<f64>>>,
}

/// The canvas of one frame.
struct Canvas<'a> {
    entry: &'a ImageEntry,
    response: Response,
    rect: Rect,
    transform: ScreenFromImage,
    picture: Option<Arc<GreyImage>>,
    marks: Arc<Marks>,
    pointer: Option<Pos2>,
    hovered: Option<Hovered>,
}

impl ImageView {
    /// A view of an image, all of it in sight.
    #[must_use]
    pub fn new(image: ImageId) -> Self {
        Self {
            image,
            overlays: Overlays::default(),
            exaggeration: 200.0,
            loupe: Loupe::Closed,
            sight: Sight::Fit,
            window: None,
            tool: Tool::Look,
            popup: None,
            marks: MarksCache::default(),
            epipolar: EpipolarCache::default(),
            status: None,
            view: u64::from(image.0),
        }
    }

    /// Shows another image in this view, all of it in sight.
    pub fn show(&mut self, image: ImageId) {
        if image != self.image {
            self.image = image;
            self.sight = Sight::Fit;
            self.window = None;
            self.popup = None;
            self.tool = Tool::Look;
        }
    }

    /// Brings a place (px) into the middle, magnified `scale` screen points per pixel.
    pub fn look_at(&mut self, place_px: Vector2<f64>, scale: f64) {
        self.sight = Sight::At {
            centre: place_px,
            scale,
        };
    }

    /// Shows the whole picture.
    pub fn fit(&mut self) {
        self.sight = Sight::Fit;
    }

    /// Place, grey value and magnification under the pointer, for the status line.
    #[must_use]
    pub fn status(&self) -> Option<String> {
        self.status.clone()
    }

    /// Whether a list is open or a click measures: then `Esc` is this view's.
    #[must_use]
    pub fn wants_escape(&self) -> bool {
        self.popup.is_some() || self.tool == Tool::Measure
    }

    /// Draws the view.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        self.status = None;
        let Some(entry) = context.network.images.get(&self.image).map(Arc::clone) else {
            ui.weak("This image is no longer part of the project.");
            return;
        };
        self.view = ui.id().with("image view").value();
        let state = context.pictures.get(self.image, &entry);
        let picture = match &state {
            PictureState::Ready(picture) => Some(Arc::clone(picture)),
            PictureState::Loading | PictureState::Missing(_) => None,
        };
        self.toolbar(ui, picture.as_deref());
        let canvas = self.canvas(ui, context, &entry, picture);
        self.keys(ui, &canvas, context, actions);
        self.clicks(&canvas, context, actions);
        self.draw(ui, &canvas, context);
        self.tooltip(&canvas, context);
        self.status = status_of(&canvas);
        hints(ui, &canvas, &state, actions);
        self.popups(ui, &canvas, context, actions);
    }

    fn toolbar(&mut self, ui: &mut Ui, picture: Option<&GreyImage>) {
        ui.horizontal(|ui| {
            if ui
                .button("Fit")
                .on_hover_text("The whole picture (F)")
                .clicked()
            {
                self.sight = Sight::Fit;
            }
            overlay_menu(ui, self);
            let measuring = ui.selectable_label(self.tool == Tool::Measure, "Measure");
            if measuring
                .on_hover_text("A click measures a dot that detection did not find (A)")
                .clicked()
            {
                self.toggle_measure();
            }
            let loupe = ui.selectable_label(self.loupe == Loupe::Open, "Loupe");
            if loupe
                .on_hover_text("16 times round the pointer (Z)")
                .clicked()
            {
                self.toggle_loupe();
            }
            let contrast = ui.button("Contrast");
            let text =
                "Automatic contrast (0); W and drag, or drag with the right button, changes it";
            if contrast.on_hover_text(text).clicked() {
                self.window = picture.map(GreyWindow::of_picture);
            }
        });
    }

    fn toggle_measure(&mut self) {
        self.tool = match self.tool {
            Tool::Look => Tool::Measure,
            Tool::Measure => Tool::Look,
        };
    }

    fn toggle_loupe(&mut self) {
        self.loupe = match self.loupe {
            Loupe::Closed => Loupe::Open,
            Loupe::Open => Loupe::Closed,
        };
    }

    /// Takes the rest of the panel; zooms, pans, and changes the contrast.
    fn canvas<'a>(
        &mut self,
        ui: &mut Ui,
        context: &ViewContext<'_>,
        entry: &'a ImageEntry,
        picture: Option<Arc<GreyImage>>,
    ) -> Canvas<'a> {
        let size = ui.available_size().max(vec2(40.0, 40.0));
        let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        let name = "image view";
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, name));
        if let (None, Some(picture)) = (self.window, &picture) {
            self.window = Some(GreyWindow::of_picture(picture));
        }
        let pixels = [entry.file.width_px, entry.file.height_px];
        self.navigate(ui, &response, pixels, picture.as_deref());
        let transform = self.sight.transform(rect, pixels);
        let marks = self.marks.get(context.network, self.image);
        let pointer = if response.contains_pointer() {
            response.hover_pos()
        } else {
            None
        };
        let hovered = pointer.and_then(|at| hover::hovered(&marks, &transform, self.overlays, at));
        Canvas {
            entry,
            response,
            rect,
            transform,
            picture,
            marks,
            pointer,
            hovered,
        }
    }

    fn navigate(
        &mut self,
        ui: &Ui,
        response: &Response,
        size: [u32; 2],
        picture: Option<&GreyImage>,
    ) {
        /// Points of scrolling that double the magnification.
        const DOUBLING: f32 = 150.0;
        let rect = response.rect;
        if let Some(pointer) = response.hover_pos().filter(|_| response.contains_pointer()) {
            let (scroll, pinch) =
                ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            let factor = f64::from((scroll / DOUBLING).exp2() * pinch);
            if factor != 1.0 {
                self.sight = self.sight.zoomed(rect, size, pointer, factor);
            }
        }
        let drag = response.drag_delta();
        if drag == egui::Vec2::ZERO {
            return;
        }
        let contrast = response.dragged_by(PointerButton::Secondary)
            || ui.input(|input| input.key_down(Key::W));
        if !contrast {
            self.sight = self.sight.moved(rect, size, drag);
        } else if let (Some(window), Some(picture)) = (self.window, picture) {
            self.window = Some(window.dragged(drag, f64::from(picture.depth().white())));
        }
    }

    fn keys(
        &mut self,
        ui: &Ui,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let open = canvas.pointer.is_some() || canvas.response.has_focus();
        if !open || self.popup.is_some() || ui.ctx().text_edit_focused() {
            return;
        }
        let pressed = |key: Key| ui.input_mut(|input| input.consume_key(Modifiers::NONE, key));
        if pressed(Key::F) {
            self.sight = Sight::Fit;
        }
        if pressed(Key::Num1) {
            let middle = canvas.pointer.unwrap_or(canvas.rect.center());
            let per_point = f64::from(ui.ctx().pixels_per_point());
            let factor = 1.0 / (canvas.transform.scale * per_point);
            let size = [canvas.entry.file.width_px, canvas.entry.file.height_px];
            self.sight = self.sight.zoomed(canvas.rect, size, middle, factor);
        }
        if pressed(Key::Num0) {
            self.window = canvas.picture.as_deref().map(GreyWindow::of_picture);
        }
        if pressed(Key::Z) {
            self.toggle_loupe();
        }
        if self.tool == Tool::Measure && pressed(Key::Escape) {
            self.tool = Tool::Look;
        }
        if pressed(Key::A) {
            self.measure_key(canvas, context);
        }
        self.dot_keys(&pressed, canvas, context, actions);
    }

    /// `A` over a missed target or a refused candidate measures there at once; elsewhere the next click measures.
    fn measure_key(&mut self, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let place = match canvas.hovered {
            Some(Hovered::Missed(missed)) => Some(missed.place_px),
            Some(Hovered::Candidate(slot)) => {
                let detections = canvas.marks.detections.as_ref();
                detections
                    .and_then(|d| d.rejected.get(slot))
                    .map(|rejected| rejected.place_px)
            }
            _ => None,
        };
        match place {
            Some(place) => self.measure(canvas, context, place),
            None => self.toggle_measure(),
        }
    }

    fn dot_keys(
        &mut self,
        pressed: &dyn Fn(Key) -> bool,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let selected = selected_dot(&canvas.marks, self.image, context.selection);
        let hovered = match canvas.hovered {
            Some(Hovered::Dot(dot)) => Some(dot),
            _ => None,
        };
        let Some(dot) = hovered.or(selected) else {
            return;
        };
        let image = self.image;
        if pressed(Key::X) {
            actions.push(Action::Edit(Edit::Reject { image, dot }));
        }
        if pressed(Key::R) {
            actions.push(Action::Edit(Edit::Restore { image, dot }));
        }
        if pressed(Key::Delete) {
            actions.push(Action::Edit(Edit::Unlabel { image, dot }));
        }
        if pressed(Key::L) {
            self.open_labels(Subject::Dot(dot), canvas, context.network);
        }
        let reading = canvas.marks.of(dot).and_then(|mark| mark.reading);
        let code = reading.and_then(|reading| {
            Some((
                reading,
                canvas.marks.detections.as_ref()?.codes.get(reading)?,
            ))
        });
        if let Some((reading, code)) = code
            && pressed(Key::N)
        {
            let at = canvas.pointer.unwrap_or(canvas.rect.center());
            self.popup = Some(Popup::Number(NumberPopup::new(
                reading,
                at,
                code.family.code_count(),
            )));
        }
    }

    fn open_labels(&mut self, subject: Subject, canvas: &Canvas<'_>, network: &Network) {
        let place = match &subject {
            Subject::Dot(dot) => canvas.marks.of(*dot).map(|mark| mark.dot.centre_px),
            Subject::New { dot, .. } => Some(dot.centre_px),
        };
        let Some(place) = place else {
            return;
        };
        let ranked = rank_labels(network, self.image, place);
        let on_screen = canvas.transform.point(place);
        let at = if canvas.rect.contains(on_screen) {
            on_screen
        } else {
            canvas.rect.center()
        };
        self.popup = Some(Popup::Label(LabelPopup::new(subject, at, ranked)));
    }

    /// Measures at a place and asks for the label.
    fn measure(&mut self, canvas: &Canvas<'_>, context: &ViewContext<'_>, place: Vector2<f64>) {
        let Some(picture) = &canvas.picture else {
            return;
        };
        let inside = place.x >= 0.0
            && place.y >= 0.0
            && place.x < picture.width() as f64
            && place.y < picture.height() as f64;
        // A dot is added to detections; before them there is nothing to add it to.
        let Some(detections) = canvas.marks.detections.as_ref().filter(|_| inside) else {
            return;
        };
        let (dot, note): (Dot, String) =
            match measure_at(picture, place, &MeasureAtSettings::default()) {
                Ok(dot) => {
                    let note = format!(
                        "Measured: sigma {}",
                        crate::ui::format::sigma(dot.sigma_px, "px")
                    );
                    (dot, note)
                }
                Err(reason) => {
                    let dot = centre_by_hand(picture, place, &detections.dots);
                    let note = format!(
                        "Not measurable: {reason}. Set by hand, sigma {:.1} px",
                        dot.sigma_px
                    );
                    (dot, note)
                }
            };
        self.tool = Tool::Look;
        // A dot that is there already is named, not added a second time.
        let known = canvas
            .marks
            .dots
            .iter()
            .find(|mark| (mark.dot.centre_px - dot.centre_px).norm() < 1.0);
        let subject = known.map_or(Subject::New { dot, note }, |mark| Subject::Dot(mark.index));
        self.open_labels(subject, canvas, context.network);
    }

    fn clicks(
        &mut self,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let response = &canvas.response;
        if response.double_clicked() && canvas.hovered.is_none() {
            self.sight = Sight::Fit;
            return;
        }
        let Some(at) = response
            .interact_pointer_pos()
            .filter(|_| response.clicked())
        else {
            return;
        };
        if self.tool == Tool::Measure {
            self.measure(canvas, context, canvas.transform.pixel(at));
            return;
        }
        self.popup = None;
        let image = Some(self.image);
        let selection = match hover::hovered(&canvas.marks, &canvas.transform, self.overlays, at) {
            Some(Hovered::Dot(dot)) => {
                let point = canvas.marks.of(dot).and_then(|mark| mark.point);
                Selection {
                    point,
                    image,
                    dot: Some((self.image, dot)),
                }
            }
            Some(Hovered::Missed(missed)) => Selection {
                point: Some(missed.point),
                image,
                dot: None,
            },
            Some(Hovered::Candidate(_)) | None => Selection {
                point: None,
                image,
                dot: None,
            },
        };
        actions.push(Action::Select(selection));
    }

    fn draw(&mut self, ui: &Ui, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let painter = ui.painter_at(canvas.rect);
        // The surroundings of a dark picture are dark in both themes: the eye judges grey against them.
        painter.rect_filled(canvas.rect, 0.0, Color32::from_gray(24));
        self.paint_picture(&painter, canvas, canvas.rect, canvas.transform, self.view);
        self.epipolar.update(context, self.image, &canvas.marks);
        self.overlay(&painter, canvas, context, canvas.rect, canvas.transform);
        if self.loupe == Loupe::Open
            && let Some(pointer) = canvas.pointer
        {
            self.draw_loupe(ui, canvas, context, pointer);
        }
    }

    fn paint_picture(
        &self,
        painter: &egui::Painter,
        canvas: &Canvas<'_>,
        rect: Rect,
        transform: ScreenFromImage,
        view: u64,
    ) {
        if let (Some(picture), Some(window)) = (&canvas.picture, self.window) {
            let callback = PictureCallback {
                view,
                image: self.image,
                picture: Arc::clone(picture),
                transform,
                rect,
                window,
                context: painter.ctx().clone(),
            };
            painter.add(egui_wgpu::Callback::new_paint_callback(rect, callback));
        }
    }

    fn overlay(
        &self,
        painter: &egui::Painter,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        rect: Rect,
        transform: ScreenFromImage,
    ) {
        let easel = Easel {
            painter,
            rect,
            transform,
            overlays: self.overlays,
            exaggeration: self.exaggeration,
        };
        easel.epipolar(&self.epipolar.lines);
        easel.draw(&canvas.marks);
        let marks = &canvas.marks;
        if let Some(mark) =
            selected_dot(marks, self.image, context.selection).and_then(|dot| marks.of(dot))
        {
            easel.selected(mark.dot.centre_px, mark.dot.major_px);
        } else if let Some(missed) = context
            .selection
            .point
            .and_then(|point| marks.missed.iter().find(|m| m.point == point))
        {
            easel.selected(missed.place_px, 6.0);
        }
        if let Some(Popup::Label(LabelPopup {
            subject: Subject::New { dot, .. },
            ..
        })) = &self.popup
        {
            easel.outline(dot, Stroke::new(2.0, crate::ui::theme::SELECTED));
        }
    }

    fn draw_loupe(&self, ui: &Ui, canvas: &Canvas<'_>, context: &ViewContext<'_>, pointer: Pos2) {
        let side = LOUPE_SIDE
            .min(0.6 * canvas.rect.width())
            .min(0.6 * canvas.rect.height());
        let margin = vec2(8.0, 8.0);
        let mut rect = Rect::from_min_max(
            canvas.rect.max - margin - vec2(side, side),
            canvas.rect.max - margin,
        );
        if rect.expand(20.0).contains(pointer) {
            rect = Rect::from_min_size(canvas.rect.min + margin, vec2(side, side));
        }
        let painter = ui.painter_at(rect);
        let transform =
            ScreenFromImage::centred(rect, canvas.transform.pixel(pointer), LOUPE_SCALE);
        painter.rect_filled(rect, 0.0, Color32::from_gray(24));
        self.paint_picture(&painter, canvas, rect, transform, self.view.wrapping_add(1));
        self.overlay(&painter, canvas, context, rect, transform);
        let line = Stroke::new(1.0, Color32::from_white_alpha(120));
        let centre = rect.center();
        painter.line_segment([centre - vec2(6.0, 0.0), centre + vec2(6.0, 0.0)], line);
        painter.line_segment([centre - vec2(0.0, 6.0), centre + vec2(0.0, 6.0)], line);
        painter.rect_stroke(
            rect,
            0.0,
            Stroke::new(1.0, Color32::from_gray(140)),
            egui::StrokeKind::Inside,
        );
    }

    fn tooltip(&self, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let Some(hovered) = canvas
            .hovered
            .filter(|_| self.popup.is_none() && !canvas.response.dragged())
        else {
            return;
        };
        let marks = &canvas.marks;
        canvas
            .response
            .clone()
            .on_hover_ui_at_pointer(|ui| match hovered {
                Hovered::Dot(dot) => {
                    if let Some(mark) = marks.of(dot) {
                        hover::dot_tooltip(ui, mark);
                    }
                }
                Hovered::Missed(missed) => hover::missed_tooltip(ui, &missed, context.network),
                Hovered::Candidate(slot) => {
                    if let Some(rejected) =
                        marks.detections.as_ref().and_then(|d| d.rejected.get(slot))
                    {
                        hover::candidate_tooltip(ui, rejected);
                    }
                }
            });
    }

    fn popups(
        &mut self,
        ui: &Ui,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let id = canvas.response.id.with("popup");
        let image = self.image;
        match &mut self.popup {
            Some(Popup::Label(popup)) => {
                let Some(choice) = popup.ui(ui.ctx(), id, context.network) else {
                    return;
                };
                let subject = popup.subject.clone();
                actions.extend(edit_of(image, subject, &choice).map(Action::Edit));
                self.popup = None;
            }
            Some(Popup::Number(popup)) => {
                let Some(entered) = popup.ui(ui.ctx(), id) else {
                    return;
                };
                if let Entered::Number(id) = entered {
                    let reading = popup.reading;
                    actions.push(Action::Edit(Edit::Renumber { image, reading, id }));
                }
                self.popup = None;
            }
            None => {}
        }
    }
}

fn edit_of(image: ImageId, subject: Subject, choice: &Choice) -> Option<Edit> {
    let point = match choice {
        Choice::Point(point) => Some(*point),
        Choice::NoName => None,
        Choice::Cancel => return None,
    };
    match (subject, point) {
        (Subject::Dot(dot), Some(point)) => Some(Edit::Label { image, dot, point }),
        (Subject::Dot(_), None) => None,
        (Subject::New { dot, .. }, point) => Some(Edit::AddDot { image, dot, point }),
    }
}

/// The dot of this image that is selected itself, or by its point.
fn selected_dot(marks: &Marks, image: ImageId, selection: &Selection) -> Option<DotIndex> {
    match selection.dot {
        Some((of, dot)) if of == image => Some(dot),
        _ => selection
            .point
            .and_then(|point| marks.of_point(point))
            .map(|mark| mark.index),
    }
}

impl EpipolarCache {
    fn update(&mut self, context: &ViewContext<'_>, image: ImageId, marks: &Arc<Marks>) {
        let known = self.of.as_ref().is_some_and(|(selection, of)| {
            selection == context.selection && Arc::ptr_eq(of, marks)
        });
        if !known {
            let point: Option<PointId> = context.selection.point;
            self.lines =
                prediction::epipolar_lines(context.network, image, context.selection.dot, point);
            self.of = Some((context.selection.clone(), Arc::clone(marks)));
        }
    }
}

fn overlay_menu(ui: &mut Ui, view: &mut ImageView) {
    let config = egui::containers::menu::MenuConfig::new()
        .close_behavior(egui::PopupCloseBehavior::CloseOnClickOutside);
    egui::containers::menu::MenuButton::new("Overlays")
        .config(config)
        .ui(ui, |ui| {
            for overlay in Overlay::ALL {
                let mut shown = view.overlays.shows(overlay);
                if ui.checkbox(&mut shown, overlay.name()).changed() {
                    view.overlays.toggle(overlay);
                }
            }
            ui.separator();
            ui.add(
                egui::Slider::new(&mut view.exaggeration, 1.0..=5000.0)
                    .logarithmic(true)
                    .text("times the residuals"),
            );
            ui.separator();
            for (class, meaning) in [
                (DotClass::Used, "used"),
                (DotClass::Code, "dot of a code"),
                (DotClass::Doubtful, "no certain label"),
                (DotClass::Rejected, "rejected"),
            ] {
                ui.colored_label(class.colour(), meaning);
            }
            ui.colored_label(crate::ui::theme::PREDICTED, "missed, predicted place");
            ui.colored_label(crate::ui::theme::SELECTED, "selected, epipolar lines");
        });
}

fn status_of(canvas: &Canvas<'_>) -> Option<String> {
    let place = canvas.transform.pixel(canvas.pointer?);
    let file = &canvas.entry.file;
    let name = file.path.rsplit('/').next().unwrap_or(&file.path);
    let inside = place.x >= 0.0
        && place.y >= 0.0
        && place.x < f64::from(file.width_px)
        && place.y < f64::from(file.height_px);
    let grey = canvas
        .picture
        .as_ref()
        .filter(|_| inside)
        .and_then(|picture| {
            let (column, row) = (place.x as usize, place.y as usize);
            let known = column < picture.width() && row < picture.height();
            known.then(|| format!("   grey {:.0}", picture.at(column, row)))
        });
    let zoom = canvas.transform.scale * f64::from(canvas.response.ctx.pixels_per_point()) * 100.0;
    Some(format!(
        "{name}   x {:.2} px   y {:.2} px{}   zoom {zoom:.0} %",
        place.x,
        place.y,
        grey.unwrap_or_default()
    ))
}

/// What is missing, and what helps.
fn hints(ui: &mut Ui, canvas: &Canvas<'_>, state: &PictureState, actions: &mut Vec<Action>) {
    let mut lines: Vec<String> = Vec::new();
    match state {
        PictureState::Ready(_) => {}
        PictureState::Loading => lines.push("Reading the picture".into()),
        PictureState::Missing(reason) => {
            lines.push(format!("The picture cannot be read. {reason}"))
        }
    }
    let detections = canvas.entry.detections.as_ref();
    if let Some(reason) = &canvas.entry.unreadable {
        lines.push(format!("Nothing was detected here: {reason}"));
    } else if detections.is_none() {
        lines.push("Nothing is detected in this image yet: the stage detect comes first.".into());
    } else if detections.is_some_and(|d| d.dots.is_empty()) {
        lines.push("Detection found no targets here. A and a click measures one by hand.".into());
    }
    if lines.is_empty() {
        return;
    }
    let area = Rect::from_center_size(
        canvas.rect.center_top() + vec2(0.0, 50.0),
        vec2(canvas.rect.width() - 20.0, 80.0),
    );
    ui.scope_builder(egui::UiBuilder::new().max_rect(area), |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            for line in lines {
                ui.label(line);
            }
            if detections.is_none() && ui.button("Detect targets").clicked() {
                actions.push(Action::Run(RunRequest::Until(Stage::Detect)));
            }
        });
    });
}
