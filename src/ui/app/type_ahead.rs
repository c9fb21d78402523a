//! Keys typed ahead: what was typed while a slow frame was drawn means what it would have meant one key at a time.
//!
//! A frame hears all events since the last one at once. Of `Ctrl+K point M7 Enter X`, typed within a frame, the letters
//! would go to whatever had the keyboard before the palette opened. So a frame hears keys only up to the first that may
//! change what the next one means; the rest waits for the next frame, in its order.
//!
//! A key that is held is pressed again and again. That is heard where it is meant: in a text field, and for keys that
//! move. What decides is heard once for each press.

use std::collections::BTreeSet;

use egui::{Context, Event, Key, Modifiers, RawInput};

/// Events that wait for the next frame.
#[derive(Default)]
pub(super) struct TypeAhead {
    waiting: Vec<Event>,
    keyboard: Keyboard,
    /// Keys that are down.
    held: BTreeSet<Key>,
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
        let typing = context.text_edit_focused();
        input.events.retain_mut(|event| self.takes(event, typing));
        let mut events = std::mem::take(&mut self.waiting);
        events.append(&mut input.events);
        let keyboard = std::mem::take(&mut self.keyboard);
        let heard = heard_at_once(&events, keyboard, typing);
        self.waiting = events.split_off(heard);
        input.events = events;
        if !self.waiting.is_empty() {
            context.request_repaint();
        }
    }

    /// Whether an event that just came is to be heard; tells the presses of a held key from the first one, which egui
    /// does later.
    fn takes(&mut self, event: &mut Event, typing: bool) -> bool {
        match event {
            Event::Key {
                key,
                physical_key,
                pressed,
                repeat,
                modifiers,
            } => {
                // With another modifier the same key comes up under another name.
                let place = physical_key.unwrap_or(*key);
                if !*pressed {
                    self.held.remove(&place);
                    return true;
                }
                *repeat = !self.held.insert(place);
                let meant = match typing {
                    true => !decides(*key),
                    false => self.waiting.is_empty() && moves(*key, *modifiers),
                };
                !*repeat || meant
            }
            Event::WindowFocused(false) => {
                self.held.clear();
                true
            }
            _ => true,
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
    let function = key.name().starts_with('F') && key.name().len() > 1;
    let leaves = decides(key) || key == Key::Tab;
    leaves || function || modifiers.alt || modifiers.ctrl || modifiers.command
}

/// Whether a key decides what was typed.
fn decides(key: Key) -> bool {
    matches!(key, Key::Enter | Key::Escape)
}

/// Whether a key only moves on or back, or changes a size: held, it goes on.
fn moves(key: Key, modifiers: Modifiers) -> bool {
    match key {
        Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown => true,
        Key::PageUp | Key::PageDown | Key::Tab => true,
        Key::Plus | Key::Equals | Key::Minus => true,
        // The next and the previous image or item.
        Key::N | Key::P => !modifiers.any(),
        // Undo and redo.
        Key::Z | Key::Y => modifiers.command,
        _ => false,
    }
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

    fn release(key: Key) -> Event {
        let mut event = press(key, Modifiers::NONE);
        if let Event::Key { pressed, .. } = &mut event {
            *pressed = false;
        }
        event
    }

    #[test]
    fn a_held_key_that_moves_is_heard_at_once() {
        let events = vec![press(Key::ArrowDown, Modifiers::NONE); 5];
        assert_eq!(frames(&Context::default(), events), [5]);
    }

    #[test]
    fn a_held_key_that_decides_is_heard_once_for_each_press() {
        let held = |key: Key| vec![press(key, Modifiers::NONE); 4];
        for key in [Key::Space, Key::X, Key::Num1, Key::Enter] {
            let mut events = held(key);
            events.push(release(key));
            events.extend(held(key));
            // A press with its release, and the second press.
            assert_eq!(frames(&Context::default(), events), [2, 1], "{key:?}");
        }
        let mut ahead = TypeAhead::default();
        let mut takes = |event: &mut Event, typing| ahead.takes(event, typing);
        assert!(takes(&mut press(Key::X, Modifiers::NONE), true));
        assert!(takes(&mut press(Key::X, Modifiers::NONE), true), "a text");
        assert!(takes(&mut Event::WindowFocused(false), false));
        assert!(takes(&mut press(Key::X, Modifiers::NONE), false), "anew");
    }

    #[test]
    fn a_held_key_does_not_go_on_after_what_waits() {
        let mut events = vec![press(Key::X, Modifiers::NONE)];
        events.push(press(Key::ArrowDown, Modifiers::NONE));
        let mut ahead = TypeAhead::default();
        let mut input = RawInput {
            events,
            ..RawInput::default()
        };
        ahead.hear(&Context::default(), &mut input);
        input.events = vec![press(Key::ArrowDown, Modifiers::NONE); 3];
        ahead.hear(&Context::default(), &mut input);
        assert_eq!(input.events.len(), 1, "the first press, no more");
    }

    #[test]
    fn function_keys_end_typing_and_the_letter_f_does_not() {
        assert!(ends_typing(Key::F5, Modifiers::NONE));
        assert!(!ends_typing(Key::F, Modifiers::NONE));
        assert!(!ends_typing(Key::F, Modifiers::SHIFT));
    }
}
