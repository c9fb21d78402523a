//! The panel: keeps the viewpoint and the scene, takes the operator's hand.

use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::sync::Arc;

use eframe::egui_wgpu::RenderState;
use egui::Key;
use egui::PointerButton;
use egui::Pos2;
use egui::Rect;
use egui::Sense;
use egui::Vec2;
use egui::WidgetInfo;

use super::boxing::Boxing;
use super::boxing::points_within;
use super::camera::OrbitCamera;
use super::highlight::Chosen;
use super::highlight::Highlight;
use super::highlight::selected_colour;
use super::legend;
use super::options::DisplayOptions;
use super::overlay;
use super::picking::Picked;
use super::picking::Target;
use super::picking::pick;
use super::render;
use super::scene::ALWAYS;
use super::scene::Scene;
use super::toolbar;
use super::toolbar::Wish;
use crate::network::ImageId;
use crate::network::Network;
use crate::network::PointId;
use crate::network::Stage;
use crate::ui::action::Action;
use crate::ui::action::RunRequest;
use crate::ui::action::Selection;
use crate::ui::context::ViewContext;

/// Seconds that a new station takes to appear.
const FADE_S: f32 = 0.5;
/// Turning of the wheel, screen points, that changes the distance by a factor of e.
const SCROLL_PER_E: f32 = 250.0;
/// What an arrow key counts as, screen points of dragging.
const KEY_DRAG: f32 = 8.0;
/// Factor of the distance that a press of plus takes.
const KEY_ZOOM: f64 = 0.85;
/// What the canvas says while there is nothing to see.
/// A station that moves by more than this part of the viewing distance: the network has another frame or scale, and the
/// present viewpoint would show something else or nothing.
const JUMP: f64 = 0.5;

const NOTHING_YET: &str = "no oriented images yet: run the first pair";

/// What the scene's stations and points came to, for the counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Count {
    stations: usize,
    points: usize,
}

/// Who chose the viewpoint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Viewpoint {
    /// Nobody yet: all is kept in sight.
    #[default]
    Whole,
    /// The operator: it stays.
    Operators,
}

/// The 3D view of the network.
#[derive(Default)]
pub struct NetworkView {
    camera: OrbitCamera,
    options: DisplayOptions,
    scene: Option<Scene>,
    highlight: Highlight,
    highlighted: Option<Selection>,
    grouped: Arc<BTreeSet<PointId>>,
    boxing: Boxing,
    births: BTreeMap<ImageId, f32>,
    wish: Option<Wish>,
    /// To be brought into the middle at the next frame.
    look_at: Option<Selection>,
    /// Where the canvas was drawn last.
    canvas: Option<Rect>,
    /// Whether the viewpoint has been fitted to the present network.
    fitted: bool,
    /// Until the operator takes it in hand, the viewpoint follows the growing network.
    viewpoint: Viewpoint,
    before: Count,
    now: Count,
    scenes_made: u64,
}

impl NetworkView {
    /// Makes the view's pipelines on the graphics card: once, when the window is made. Without it the canvas stays empty.
    pub fn install(state: &RenderState) {
        render::install(state);
    }

    /// A view with nothing in it yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Shows all of the network at the next frame; to be called when another project is opened.
    pub fn fit(&mut self) {
        self.wish = Some(Wish::Fit);
        self.viewpoint = Viewpoint::Whole;
    }

    /// Brings what is selected into the middle at the next frame; direction and distance stay.
    pub fn look_at(&mut self, selection: &Selection) {
        self.look_at = Some(selection.clone());
    }

    /// The viewpoint.
    #[must_use]
    pub fn camera(&self) -> &OrbitCamera {
        &self.camera
    }

    /// What is drawn, and how.
    pub fn options_mut(&mut self) -> &mut DisplayOptions {
        &mut self.options
    }

    /// How often what there is to see was made anew.
    #[must_use]
    pub fn scenes_made(&self) -> u64 {
        self.scenes_made
    }

    /// Where a point or the centre of a station stands on the window; `None` before the first frame, for what is not
    /// there, and for what is outside of the canvas.
    #[must_use]
    pub fn place_on_screen(&self, target: Target) -> Option<Pos2> {
        let (scene, canvas) = (self.scene.as_ref()?, self.canvas?);
        let place = match target {
            Target::Point(id) => scene.point(id)?.position,
            Target::Station(id) => scene.station(id)?.centre,
        };
        let seen = self.camera.projector(canvas).project(place)?.position;
        canvas.contains(seen).then_some(seen)
    }

    /// Draws the panel and takes the operator's hand.
    pub fn ui(&mut self, ui: &mut egui::Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        self.show(
            ui,
            context.network,
            context.selection,
            context.group,
            actions,
        );
    }

    /// As [`NetworkView::ui`], without the pictures that this panel does not need.
    pub(super) fn show(
        &mut self,
        ui: &mut egui::Ui,
        network: &Network,
        selection: &Selection,
        group: &Arc<BTreeSet<PointId>>,
        actions: &mut Vec<Action>,
    ) {
        let exaggeration = self.scene.as_ref().and_then(|scene| scene.exaggeration);
        if let Some(wish) =
            toolbar::draw(ui, &mut self.options, &mut self.boxing.tool, exaggeration)
        {
            self.wish = Some(wish);
        }
        let size = ui.available_size().max(Vec2::splat(16.0));
        let response = ui.allocate_response(size, Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(egui::Role::Image, true, "3D view"));
        let canvas = response.rect;
        self.canvas = Some(canvas);
        let theme = if ui.visuals().dark_mode {
            egui::Theme::Dark
        } else {
            egui::Theme::Light
        };
        let time = ui.input(|input| input.time) as f32;
        self.update(network, selection, group, theme, time);
        let Some(scene) = self.scene.take() else {
            return;
        };
        if scene.is_empty() {
            self.fitted = false;
            self.boxing.forget();
            ui.painter_at(canvas)
                .rect_filled(canvas, 0.0, scene.palette.canvas);
            invite(ui, canvas, actions);
        } else {
            self.move_viewpoint(&scene, canvas);
            let boxing = self.boxing.takes(ui, &response);
            if !boxing {
                self.boxing.forget();
                self.take_hand(ui, &response, &scene);
            }
            let picked = response
                .hover_pos()
                .filter(|_| !response.dragged())
                .and_then(|pointer| pick(&scene, &self.options, &self.camera, canvas, pointer));
            self.paint(ui, canvas, &scene, network, selection, theme, time);
            // Over what is painted.
            if boxing && let Some(rect) = self.boxing.drag(ui, &response, selected_colour(theme)) {
                let within = points_within(&scene, &self.camera, canvas, rect);
                actions.push(Action::Group(within));
            }
            self.hover(ui, &response, &scene, network, picked, theme);
            click(&response, picked, network, selection, actions);
        }
        self.scene = Some(scene);
    }

    /// Makes scene and highlight anew where what they come from is another.
    fn update(
        &mut self,
        network: &Network,
        selection: &Selection,
        group: &Arc<BTreeSet<PointId>>,
        theme: egui::Theme,
        time: f32,
    ) {
        let same_scene = self
            .scene
            .as_ref()
            .is_some_and(|scene| scene.is_of(network, &self.options, theme));
        if !same_scene {
            self.note_births(network, time);
            let scene = Scene::new(network, &self.options, theme, &self.births);
            self.scenes_made += 1;
            let count = Count {
                stations: scene.stations.len(),
                points: scene.points.len(),
            };
            if count != self.now {
                if count.stations != self.now.stations && self.viewpoint == Viewpoint::Whole {
                    self.wish = self.wish.or(Some(Wish::Fit));
                }
                self.before = std::mem::replace(&mut self.now, count);
            }
            let limit = JUMP * self.camera.distance;
            if self.fitted && (self.scene.as_ref()).is_some_and(|old| scene.moved(old) > limit) {
                self.wish = self.wish.or(Some(Wish::Fit));
            }
            self.scene = Some(scene);
        }
        if let Some(scene) = &self.scene
            && (!same_scene
                || self.highlighted.as_ref() != Some(selection)
                || !Arc::ptr_eq(&self.grouped, group))
        {
            let chosen = Chosen { selection, group };
            self.highlight = Highlight::new(scene, network, chosen, &self.options, theme);
            self.highlighted = Some(selection.clone());
            self.grouped = Arc::clone(group);
        }
    }

    /// Stations that come to a network on screen begin to fade in; all that are there at first are simply there.
    fn note_births(&mut self, network: &Network, time: f32) {
        let birth = if self.fitted { time } else { ALWAYS };
        let present: BTreeMap<ImageId, f32> = network
            .oriented_images()
            .map(|(id, _, _)| (id, self.births.get(&id).copied().unwrap_or(birth)))
            .collect();
        self.births = present;
    }

    fn move_viewpoint(&mut self, scene: &Scene, canvas: Rect) {
        if !self.fitted {
            self.fitted = true;
            self.wish = self.wish.or(Some(Wish::Fit));
        }
        if let Some(wish) = self.wish.take() {
            if let Wish::View(view) = wish {
                self.camera.turn_to(view);
            }
            self.camera.fit(scene.places(), canvas);
        }
        if let Some(selection) = self.look_at.take() {
            let point = selection
                .point
                .and_then(|id| scene.point(id))
                .map(|point| point.position);
            let station = || {
                selection
                    .image
                    .and_then(|id| scene.station(id))
                    .map(|station| station.centre)
            };
            if let Some(place) = point.or_else(station) {
                self.viewpoint = Viewpoint::Operators;
                self.camera.target = place;
            }
        }
    }

    fn take_hand(&mut self, ui: &egui::Ui, response: &egui::Response, scene: &Scene) {
        let before = self.camera;
        self.turn_and_zoom(ui, response, scene);
        if self.camera != before {
            self.viewpoint = Viewpoint::Operators;
        }
    }

    fn turn_and_zoom(&mut self, ui: &egui::Ui, response: &egui::Response, scene: &Scene) {
        let canvas = response.rect;
        let modifiers = ui.input(|input| input.modifiers);
        let drag = response.drag_delta();
        if response.dragged_by(PointerButton::Primary) && modifiers.ctrl {
            self.camera.roll(drag);
        } else if response.dragged_by(PointerButton::Primary) && !modifiers.shift {
            self.camera.orbit(drag);
        } else if response.dragged() {
            self.camera.pan(drag, canvas);
        }
        if let Some(pointer) = response.hover_pos() {
            let (scroll, pinch) =
                ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            let factor = f64::from((-scroll / SCROLL_PER_E).exp() / pinch);
            if (factor - 1.0).abs() > 1e-6 {
                let under = pick(scene, &self.options, &self.camera, canvas, pointer);
                let projector = self.camera.projector(canvas);
                // Between the points there is nothing to hold on to but the target's depth.
                let depth = under.map_or(self.camera.distance, |picked| picked.seen.depth);
                self.camera
                    .zoom(projector.unproject(pointer, depth), factor);
            }
        }
        let typing = ui.ctx().egui_wants_keyboard_input() && !response.has_focus();
        if (response.hovered() || response.has_focus()) && !typing {
            if ui.input(|input| input.key_pressed(Key::F)) {
                self.camera.fit(scene.places(), canvas);
            }
            self.take_keys(ui, response);
        }
    }

    /// Arrows turn, with shift they shift; plus and minus move nearer to the target and away from it.
    fn take_keys(&mut self, ui: &egui::Ui, response: &egui::Response) {
        let filter = egui::EventFilter {
            horizontal_arrows: true,
            vertical_arrows: true,
            ..Default::default()
        };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
        let pressed = |key| ui.input(|input| input.key_pressed(key));
        let modifiers = ui.input(|input| input.modifiers);
        let step = [
            (Key::ArrowLeft, Vec2::new(-1.0, 0.0)),
            (Key::ArrowRight, Vec2::new(1.0, 0.0)),
            (Key::ArrowUp, Vec2::new(0.0, -1.0)),
            (Key::ArrowDown, Vec2::new(0.0, 1.0)),
        ]
        .into_iter()
        .filter(|(key, _)| pressed(*key))
        .fold(Vec2::ZERO, |sum, (_, step)| sum + step * KEY_DRAG);
        // To turn by nothing rounds, and would count as the operator's hand.
        if step != Vec2::ZERO {
            if modifiers.shift {
                self.camera.pan(step, response.rect);
            } else {
                self.camera.orbit(step);
            }
        }
        // With Ctrl they make everything larger or smaller.
        if modifiers.command {
            return;
        }
        if pressed(Key::Plus) || pressed(Key::Equals) {
            self.camera.zoom(self.camera.target, KEY_ZOOM);
        }
        if pressed(Key::Minus) {
            self.camera.zoom(self.camera.target, 1.0 / KEY_ZOOM);
        }
    }

    #[allow(clippy::too_many_arguments, reason = "what a frame shows, all of it")]
    fn paint(
        &self,
        ui: &egui::Ui,
        canvas: Rect,
        scene: &Scene,
        network: &Network,
        selection: &Selection,
        theme: egui::Theme,
        time: f32,
    ) {
        let grown = self.births.values().copied().fold(ALWAYS, f32::max) + FADE_S;
        if time < grown {
            ui.ctx().request_repaint();
        }
        let painter = ui.painter_at(canvas);
        let frame = render::Frame {
            view: ui.scope_id().value(),
            rect: canvas,
            uniform: render::ViewUniform {
                clip_from_scene: self
                    .camera
                    .clip_from_scene(scene.origin, canvas)
                    .to_cols_array_2d(),
                towards: self.camera.towards().as_vec3().extend(0.0).to_array(),
                size_px: [1.0; 2],
                px_per_point: 1.0,
                // Stands still while nothing fades, so that the picture need not be drawn again.
                time: time.min(grown),
                fade: FADE_S,
                near: self.camera.near() as f32,
                unused: [0.0; 2],
            },
            background: scene.palette.canvas,
            scene: Arc::clone(&scene.layer),
            highlight: Arc::clone(&self.highlight.layer),
        };
        painter.rect_filled(canvas, 0.0, scene.palette.canvas);
        painter.add(frame.shape());
        overlay::draw_names(
            &painter,
            canvas,
            scene,
            network,
            &self.options,
            &self.camera,
            selection.point,
        );
        overlay::draw_axes(&painter, canvas, scene, &self.camera);
        overlay::draw_length_scale(&painter, canvas, scene, &self.camera);
        legend::draw(ui, canvas, scene, &self.highlight, &self.options, theme);
        let place = Rect::from_min_size(canvas.min + Vec2::new(8.0, 6.0), Vec2::new(240.0, 16.0));
        let text = self.counter();
        painter.text(
            place.min,
            egui::Align2::LEFT_TOP,
            &text,
            egui::FontId::proportional(12.0),
            scene.palette.text,
        );
        ui.interact(place, ui.scope_id().with("counter"), Sense::hover())
            .widget_info(|| WidgetInfo::labeled(egui::Role::Label, true, &text));
    }

    /// How many there are, and what came last.
    fn counter(&self) -> String {
        let change = |now: usize, before: usize| match now.checked_sub(before) {
            Some(more) if more > 0 && before > 0 => format!(" (+{more})"),
            _ => String::new(),
        };
        let (now, before) = (self.now, self.before);
        format!(
            "{} stations{}, {} points{}",
            now.stations,
            change(now.stations, before.stations),
            now.points,
            change(now.points, before.points)
        )
    }

    fn hover(
        &self,
        ui: &egui::Ui,
        response: &egui::Response,
        scene: &Scene,
        network: &Network,
        picked: Option<Picked>,
        theme: egui::Theme,
    ) {
        let (Some(picked), Some(pointer)) = (picked, response.hover_pos()) else {
            return;
        };
        let painter = ui.painter_at(response.rect);
        painter.circle_stroke(
            picked.seen.position,
            7.0,
            egui::Stroke::new(1.5, selected_colour(theme)),
        );
        overlay::draw_plate(
            &painter,
            response.rect,
            scene,
            pointer,
            overlay::describe(network, picked.target),
        );
        ui.ctx().set_cursor_icon(egui::CursorIcon::PointingHand);
    }
}

/// The empty canvas: what comes first, and a button for it.
fn invite(ui: &mut egui::Ui, canvas: Rect, actions: &mut Vec<Action>) {
    let centre = canvas.center();
    ui.put(
        Rect::from_center_size(centre, Vec2::new(canvas.width(), 20.0)),
        egui::Label::new(NOTHING_YET),
    );
    let place = Rect::from_center_size(centre + Vec2::new(0.0, 30.0), Vec2::new(140.0, 24.0));
    if ui
        .put(place, egui::Button::new("Run the first pair"))
        .clicked()
    {
        actions.push(Action::Run(RunRequest::Until(Stage::FirstPair)));
    }
}

/// Asks for what a click means: select what is under the pointer, or no point where there is none.
fn click(
    response: &egui::Response,
    picked: Option<Picked>,
    network: &Network,
    selection: &Selection,
    actions: &mut Vec<Action>,
) {
    if !response.clicked() {
        return;
    }
    let wanted = match picked.map(|picked| picked.target) {
        Some(Target::Point(id)) => select_point(network, selection, id),
        Some(Target::Station(id)) => Selection {
            image: Some(id),
            point: selection.point,
            ..Selection::default()
        },
        None => Selection {
            image: selection.image,
            ..Selection::default()
        },
    };
    if picked.is_some() && response.double_clicked() {
        actions.push(Action::LookAt(wanted));
    } else if wanted != *selection {
        actions.push(Action::Select(wanted));
    }
}

/// The point with its dot in the selected image, where it has one.
fn select_point(network: &Network, selection: &Selection, id: PointId) -> Selection {
    let dot = selection.image.and_then(|image| {
        let labels = &network.images.get(&image)?.labels;
        labels
            .iter()
            .find(|(_, label)| label.point == id)
            .map(|(dot, _)| (image, *dot))
    });
    Selection {
        point: Some(id),
        image: selection.image,
        dot,
        ..Selection::default()
    }
}
