//! One image: its grey picture with everything that is known of it, and the tools to mend it by hand.
//!
//! The picture is drawn by the graphics card from tiles with mip levels (`tiles`), window and level in the shader. All
//! that is drawn over it goes through one transform (`transform`) and is gathered once per document (`marks`).
//! Predicted places and epipolar lines come from the image's station and camera (`prediction`).
//!
//! Keys, while the pointer is over the image: `F` fit, `1` one to one, `Z` loupe, `W` + drag window and level, `0`
//! contrast for what is in sight, `L` label, `X` reject, `R` restore, `Delete` take the label away, `A` measure, `N` number of
//! the selected code.

mod draw;
mod hover;
mod labelling;
mod lettering;
mod levels;
mod marks;
mod measuring;
mod notes;
mod occupancy;
mod overlay;
mod prediction;
mod question;
#[cfg(test)]
mod tests;
mod tiles;
mod toolbar;
mod tools;
mod transform;
mod visibility;
mod window;

use std::sync::Arc;

use egui::{Key, PointerButton, Pos2, Rect, Response, Sense, Ui, vec2};
use nalgebra::Vector2;

use crate::imaging::GreyImage;
use crate::network::{ImageEntry, ImageId};
use crate::targets::DotIndex;
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;
use crate::ui::pictures::PictureState;

use hover::Hovered;
use labelling::{LabelPopup, NumberPopup};
use marks::{Marks, MarksCache};
use notes::{hints, status_of};
use occupancy::Occupancy;
use tools::Asked;
use transform::Sight;

pub use labelling::{LabelCandidate, filtered, rank_labels};
pub use marks::DotClass;
pub use measuring::{MeasuredByHand, NOTHING_THERE};
pub use overlay::{Overlay, Overlays};
pub use prediction::{Facing, Misfit, Predicted, misfit_of, missed_targets, missed_with};
pub use question::place_of_reading;
pub use tiles::install;
pub use transform::{PixelRect, ScreenFromImage};
pub use visibility::Directions;
pub use window::GreyWindow;

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
    occupancy: Occupancy,
    /// The part of the picture that was in sight in the last frame.
    in_sight: Option<PixelRect>,
    /// What the tool in hand says to the operator.
    notice: Option<String>,
    /// A list of labels that another panel asked for.
    asked: Option<Asked>,
    status: Option<String>,
    /// Where the picture was drawn last.
    drawn: Option<Drawn>,
    /// Tells this view from others in the renderer.
    view: u64,
}

/// Where the picture stood in a frame.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    rect: Rect,
    transform: ScreenFromImage,
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
            occupancy: Occupancy::default(),
            in_sight: None,
            notice: None,
            asked: None,
            status: None,
            drawn: None,
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
            self.notice = None;
            self.asked = None;
            self.tool = Tool::Look;
        }
    }

    /// Opens the list of labels of a dot of this image.
    pub fn edit_dot(&mut self, dot: DotIndex) {
        self.asked = Some(Asked::Dot(dot));
    }

    /// Measures at a place (px) where a target was missed and opens the list of labels; where nothing can be measured
    /// the next click sets the centre.
    pub fn edit_place(&mut self, place_px: Vector2<f64>) {
        self.asked = Some(Asked::Place(place_px));
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

    /// Where a place (px) was drawn on the window; `None` before the first frame and for what is outside of the panel.
    #[must_use]
    pub fn place_on_screen(&self, place_px: Vector2<f64>) -> Option<Pos2> {
        let drawn = self.drawn?;
        let place = drawn.transform.point(place_px);
        drawn.rect.contains(place).then_some(place)
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
        self.view = ui.scope_id().with("image view").value();
        let state = context.pictures.get(self.image, &entry);
        let picture = match &state {
            PictureState::Ready(picture) => Some(Arc::clone(picture)),
            PictureState::Loading | PictureState::Missing(_) => None,
        };
        self.toolbar(ui, context, picture.as_deref(), actions);
        let canvas = self.canvas(ui, context, &entry, picture);
        self.open_asked(&canvas, context);
        self.keys(ui, &canvas, context, actions);
        self.clicks(&canvas, context, actions);
        self.draw(ui, &canvas, context);
        self.tooltip(&canvas, context);
        self.status = status_of(&canvas);
        hints(ui, &canvas, &state, self.notice.as_deref(), actions);
        self.popups(ui, &canvas, context, actions);
    }

    /// Contrast for what is in sight: the whole picture, or the part that is looked at closely.
    fn open_greys(&mut self, picture: Option<&GreyImage>) {
        let part = self.in_sight.filter(|_| self.sight != Sight::Fit);
        self.window = picture.map(|picture| match part {
            Some(part) => GreyWindow::of_part(picture, &part),
            None => GreyWindow::of_picture(picture),
        });
    }

    fn toggle_measure(&mut self) {
        self.tool = match self.tool {
            Tool::Look => Tool::Measure,
            Tool::Measure => Tool::Look,
        };
        self.notice = None;
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
        self.drawn = Some(Drawn { rect, transform });
        self.in_sight = Some(transform.visible(rect));
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
}
