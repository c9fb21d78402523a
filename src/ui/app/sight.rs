//! Which images stand in the image panels, and the same target in all of them at once.

use nalgebra::Vector2;

use super::App;
use crate::network::{ImageId, Network, PointId, ReadTarget};
use crate::ui::action::{Question, Selection};
use crate::ui::image_view::{ImageView, place_of_reading};
use crate::ui::layout::{Pane, first_layout};

/// Magnification at which a place is looked at, screen points per pixel: a dot of ten pixels becomes a coin.
const CLOSE_LOOK: f64 = 6.0;

/// Where a point stands in an image: its labelled dot, else its predicted place within the picture.
pub(super) fn place_in_image(
    network: &Network,
    image: ImageId,
    point: PointId,
) -> Option<Vector2<f64>> {
    let entry = network.images.get(&image)?;
    let labelled = entry
        .labels
        .iter()
        .find(|(_, label)| label.point == point)
        .map(|(dot, _)| *dot);
    if let (Some(dot), Some(detections)) = (labelled, &entry.detections) {
        return detections.dots.get(dot.slot()).map(|dot| dot.centre_px);
    }
    let pose = &entry.station.as_ref()?.pose;
    let camera = &network.cameras.get(&entry.camera)?.camera;
    let point = network.points.get(&point)?;
    let place = camera.image_of_target(pose, &point.position, point.circle.as_ref())?;
    let inside = place.x >= 0.0
        && place.y >= 0.0
        && place.x <= f64::from(entry.file.width_px)
        && place.y <= f64::from(entry.file.height_px);
    inside.then_some(place)
}

/// The image and place that a selection names, where it names one.
fn place_of(network: &Network, selection: &Selection) -> Option<(ImageId, Vector2<f64>)> {
    if let Some((image, [x, y])) = selection.place {
        return Some((image, Vector2::new(x, y)));
    }
    if let Some((image, dot)) = selection.dot {
        let detections = network.images.get(&image)?.detections.as_ref()?;
        return Some((image, detections.dots.get(dot.slot())?.centre_px));
    }
    let image = selection.image?;
    Some((image, place_in_image(network, image, selection.point?)?))
}

/// The images that show what is selected: those of the reading in hand, and those in which the selected point has its dot.
fn images_to_compare(network: &Network, selection: &Selection) -> Vec<ImageId> {
    let reading = selection.question.as_ref().and_then(Question::reading);
    let of_reading = reading.into_iter().flat_map(|reading| &reading.dots);
    let mut images: Vec<ImageId> = of_reading.map(|(image, _)| *image).collect();
    let known = reading.and_then(|reading| match reading.target {
        ReadTarget::New { .. } => None,
        ReadTarget::Known(point) => Some(point),
    });
    if let Some(point) = selection.point.or(known) {
        let all = network.used_images().map(|(id, _)| id);
        images.extend(all.filter(|id| shows(network, *id, point)));
    }
    images
}

/// Whether a dot of the image carries this point's label.
fn shows(network: &Network, image: ImageId, point: PointId) -> bool {
    let labels = network.images.get(&image).map(|entry| &entry.labels);
    labels.is_some_and(|labels| labels.values().any(|label| label.point == point))
}

impl App {
    /// So many image panels, filled with images that are not shown yet.
    pub(super) fn set_image_panels(&mut self, count: usize) {
        self.panels.views.resize_with(count, || None);
        self.tree = first_layout(count);
        self.fill_image_panels();
    }

    /// Gives empty image panels an image.
    pub(super) fn fill_image_panels(&mut self) {
        let ids: Vec<ImageId> = self.network().used_images().map(|(id, _)| id).collect();
        let views = &mut self.panels.views;
        for place in 0..views.len() {
            if views[place].is_none() {
                let shown = |id: &ImageId| views.iter().flatten().any(|view| view.image == *id);
                views[place] = ids
                    .iter()
                    .find(|id| !shown(id))
                    .map(|id| ImageView::new(*id));
            }
        }
    }

    /// Empties the image panels, for another document.
    pub(super) fn clear_image_panels(&mut self) {
        self.panels.views.iter_mut().for_each(|view| *view = None);
    }

    /// Shows an image in the first image panel unless one shows it already.
    pub(super) fn show_image(&mut self, id: ImageId) {
        let shown = self
            .panels
            .views
            .iter()
            .flatten()
            .any(|view| view.image == id);
        if !shown {
            self.set_view(0, id);
        }
    }

    fn set_view(&mut self, place: usize, id: ImageId) {
        match self.panels.views.get_mut(place) {
            Some(Some(view)) => view.show(id),
            Some(empty) => *empty = Some(ImageView::new(id)),
            None => {}
        }
    }

    /// The next or previous image in the first image panel.
    pub(super) fn turn_page(&mut self, forward: bool) {
        let ids: Vec<ImageId> = self.network().used_images().map(|(id, _)| id).collect();
        let Some(last) = ids.len().checked_sub(1) else {
            return;
        };
        let now = self
            .panels
            .views
            .first()
            .and_then(Option::as_ref)
            .map(|view| view.image);
        let place = now.and_then(|now| ids.iter().position(|id| *id == now));
        let next = match (place, forward) {
            (None, _) => 0,
            (Some(place), true) if place == last => 0,
            (Some(place), true) => place + 1,
            (Some(0), false) => last,
            (Some(place), false) => place - 1,
        };
        self.set_view(0, ids[next]);
        self.selection.image = Some(ids[next]);
    }

    /// Brings a selection into view everywhere: the place itself in one image panel, the same target, or the other dots of the reading
    /// in hand, in the others.
    ///
    /// Panels that show the target stay where they are, so that nothing jumps.
    pub(super) fn look_at(&mut self, selection: &Selection) {
        let network = self.network();
        let first = place_of(network, selection)
            .map(|(image, _)| image)
            .or(selection.image);
        let mut others = images_to_compare(network, selection);
        others.retain(|id| Some(*id) != first);
        if let Some(first) = first {
            self.show_image(first);
        }
        self.show_target_in_others(first, &others);
        let places: Vec<Option<Vector2<f64>>> = (self.panels.views.iter())
            .map(|view| self.place_for(view.as_ref()?.image, selection))
            .collect();
        for (view, place) in self.panels.views.iter_mut().zip(places) {
            if let (Some(view), Some(place)) = (view, place) {
                view.look_at(place, CLOSE_LOOK);
            }
        }
        self.panels.network.look_at(selection);
    }

    /// Opens the list of labels in the image panel that shows the selected dot or place.
    pub(super) fn edit_label(&mut self, selection: &Selection) {
        let image = selection.dot.map(|(image, _)| image);
        let image = image.or(selection.place.map(|(image, _)| image));
        let mut views = self.panels.views.iter_mut().flatten();
        let Some(view) = views.find(|view| Some(view.image) == image) else {
            return;
        };
        match (selection.dot, selection.place) {
            (Some((_, dot)), _) => view.edit_dot(dot),
            (None, Some((_, place))) => view.edit_place(place.into()),
            (None, None) => {}
        }
    }

    /// Panels without the target get images that show it.
    fn show_target_in_others(&mut self, first: Option<ImageId>, others: &[ImageId]) {
        let shown: Vec<Option<ImageId>> = self
            .panels
            .views
            .iter()
            .map(|view| view.as_ref().map(|view| view.image))
            .collect();
        let mut candidates = others.iter().filter(|id| !shown.contains(&Some(**id)));
        for (place, image) in shown.iter().enumerate() {
            let keeps = image.is_some_and(|image| Some(image) == first || others.contains(&image));
            if !keeps && let Some(id) = candidates.next() {
                self.set_view(place, *id);
            }
        }
    }

    fn place_for(&self, image: ImageId, selection: &Selection) -> Option<Vector2<f64>> {
        let network = self.network();
        if let Some(reading) = selection.question.as_ref().and_then(Question::reading) {
            return place_of_reading(network, image, reading);
        }
        match place_of(network, selection) {
            Some((of, place)) if of == image => Some(place),
            _ => place_in_image(network, image, selection.point?),
        }
    }

    /// Whether a panel can be seen.
    pub(super) fn is_in_front(&self, pane: Pane) -> bool {
        let shown = |id: &egui_tiles::TileId| self.tree.tiles.get_pane(id) == Some(&pane);
        self.document.is_some() && self.tree.active_tiles().iter().any(shown)
    }

    /// Brings a panel to the front.
    pub(super) fn show_pane(&mut self, pane: Pane) {
        self.tree
            .make_active(|_, tile| matches!(tile, egui_tiles::Tile::Pane(found) if *found == pane));
    }
}
