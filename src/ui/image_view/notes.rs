//! Words round the picture: the status line, hints where something is missing.

use egui::{Rect, Ui, vec2};

use super::Canvas;
use crate::network::Stage;
use crate::ui::action::{Action, RunRequest};
use crate::ui::pictures::PictureState;

pub(super) fn status_of(canvas: &Canvas<'_>) -> Option<String> {
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
pub(super) fn hints(
    ui: &mut Ui,
    canvas: &Canvas<'_>,
    state: &PictureState,
    notice: Option<&str>,
    actions: &mut Vec<Action>,
) {
    let mut lines: Vec<String> = notice.map(str::to_owned).into_iter().collect();
    match state {
        PictureState::Ready(_) => {}
        PictureState::Loading => lines.push("Reading the picture".into()),
        PictureState::Missing(reason) => {
            lines.push(format!("The picture cannot be read. {reason}"));
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
