//! Keys typed ahead: what was typed while a slow frame was drawn means what it would have meant one key at a time.
//!
//! A frame hears all events since the last one at once. Of `Ctrl+K point M7 Enter X`, typed within a frame, the letters
//! would go to whatever had the keyboard before the palette opened. So a frame hears keys only up to the first that may
//! change what the next one means; the rest waits for the next frame, in its order.

use egui::{Context, Event, Key, Modifiers, RawInput};

/// Events that wait for the next frame.
#[derive(Default)]
pub(super) struct TypeAhead {
    waiting: Vec<Event>,
    keyboard: Keyboard,
}

/// Whose the next key is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Keyboard {
    /// What has the focus.
    #[default]
    Known,
    /// A text field's that the next frame draws for the first time.
    Asked,
}

impl TypeAhead {
    /// Something with a text field opens: keys wait until the field is there.
    pub(super) fn wait_for_field(&mut self) {
        self.keyboard = Keyboard::Asked;
    }

    /// Lets this frame hear what it may; the rest waits.
    pub(super) fn hear(&mut self, context: &Context, input: &mut RawInput) {
        let mut events = std::mem::take(&mut self.waiting);
        events.append(&mut input.events);
        let keyboard = std::mem::take(&mut self.keyboard);
        let heard = heard_at_once(&events, keyboard, context.text_edit_focused());
        self.waiting = events.split_off(heard);
        input.events = events;
        if !self.waiting.is_empty() {
            context.request_repaint();
        }
    }
}

/// How many of the events one frame may hear: all up to the key after the first that may change what it means.
fn heard_at_once(events: &[Event], keyboard: Keyboard, typing: bool) -> usize {
    let mut changed = keyboard == Keyboard::Asked;
    for (place, event) in events.iter().enumerate() {
        let Event::Key {
            key,
            modifiers,
            pressed: true,
            // A held key means the same all the time, and must not go on after it was let go.
            repeat: false,
            ..
        } = event
        else {
            continue;
        };
        if changed {
            return place;
        }
        changed = !typing || ends_typing(*key, *modifiers);
    }
    events.len()
}

/// Whether a key may take the keyboard from a text field.
fn ends_typing(key: Key, modifiers: Modifiers) -> bool {
    let decides = matches!(key, Key::Enter | Key::Escape | Key::Tab);
    let function = key.name().starts_with('F') && key.name().len() > 1;
    decides || function || modifiers.alt || modifiers.ctrl || modifiers.command
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(key: Key, modifiers: Modifiers) -> Event {
        Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers,
        }
    }

    fn letter(key: Key) -> [Event; 2] {
        let text = key.name().to_lowercase();
        [press(key, Modifiers::NONE), Event::Text(text)]
    }

    fn frames(context: &Context, events: Vec<Event>) -> Vec<usize> {
        let mut ahead = TypeAhead::default();
        let mut input = RawInput {
            events,
            ..RawInput::default()
        };
        let mut heard = Vec::new();
        loop {
            ahead.hear(context, &mut input);
            heard.push(input.events.len());
            input.events.clear();
            if ahead.waiting.is_empty() {
                return heard;
            }
        }
    }

    #[test]
    fn without_a_text_field_a_frame_hears_one_key_with_its_letter() {
        let mut events = vec![press(Key::K, Modifiers::CTRL)];
        events.extend(letter(Key::M));
        events.extend(letter(Key::X));
        events.push(Event::PointerGone);
        assert_eq!(frames(&Context::default(), events), [1, 2, 3]);
    }

    #[test]
    fn a_text_field_hears_all_letters_up_to_the_key_that_ends_it() {
        let mut events: Vec<Event> = [Key::M, Key::Num7].into_iter().flat_map(letter).collect();
        events.push(press(Key::Enter, Modifiers::NONE));
        events.extend(letter(Key::X));
        assert_eq!(heard_at_once(&events, Keyboard::Known, true), 5);
    }

    #[test]
    fn keys_wait_for_a_field_that_opens() {
        let mut events = vec![Event::PointerGone];
        events.extend(letter(Key::M));
        assert_eq!(heard_at_once(&events, Keyboard::Asked, false), 1);
    }

    #[test]
    fn a_held_key_is_heard_at_once() {
        let mut events = vec![press(Key::ArrowDown, Modifiers::NONE); 5];
        for event in &mut events[1..] {
            if let Event::Key { repeat, .. } = event {
                *repeat = true;
            }
        }
        assert_eq!(heard_at_once(&events, Keyboard::Known, false), 5);
    }

    #[test]
    fn function_keys_end_typing_and_the_letter_f_does_not() {
        assert!(ends_typing(Key::F5, Modifiers::NONE));
        assert!(!ends_typing(Key::F, Modifiers::NONE));
        assert!(!ends_typing(Key::F, Modifiers::SHIFT));
    }
}
