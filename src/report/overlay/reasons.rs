//! Reasons of refusal by kind: a picture may hold hundreds, and only a handful of kinds.

use std::collections::BTreeMap;

use crate::targets::Rejected;

/// A kind of reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ReasonKind {
    /// Stands for it where there is no room for the reason itself.
    pub(super) letter: char,
    /// The reason without its numbers.
    pub(super) words: String,
    /// How many places have it.
    pub(super) count: usize,
}

/// The kinds, the most frequent first, and the place of each refusal's kind among them.
pub(super) fn reason_kinds(rejected: &[Rejected]) -> (Vec<ReasonKind>, Vec<usize>) {
    let words: Vec<String> = rejected
        .iter()
        .map(|r| without_numbers(&r.reason))
        .collect();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for words in &words {
        *counts.entry(words).or_default() += 1;
    }
    let mut sorted: Vec<(&str, usize)> = counts.into_iter().collect();
    // Stable: equal counts stay in the order of the alphabet.
    sorted.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
    let place_of: BTreeMap<&str, usize> = sorted.iter().map(|&(words, _)| words).zip(0..).collect();
    let of_each = words.iter().map(|words| place_of[words.as_str()]).collect();
    let kinds = sorted
        .into_iter()
        .enumerate()
        .map(|(place, (words, count))| ReasonKind {
            letter: letter(place),
            words: words.to_owned(),
            count,
        })
        .collect();
    (kinds, of_each)
}

/// The letters of the alphabet; all kinds beyond it share the last.
fn letter(place: usize) -> char {
    ('a'..='z').nth(place).unwrap_or('z')
}

/// What a reason says before its figures: `too small: 2.1 px` and `too small: 3.0 px` are one kind.
fn without_numbers(reason: &str) -> String {
    let head = reason.split([':', '(']).next().unwrap_or(reason).trim();
    let mut words = String::with_capacity(head.len());
    for character in head.chars() {
        match character {
            '0'..='9' if words.ends_with('#') => {}
            '0'..='9' => words.push('#'),
            other => words.push(other),
        }
    }
    words
}

/// A text in lines of at most `letters` letters, broken between words; a longer word has a line of its own.
pub(super) fn wrapped(text: &str, letters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= letters => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn reasons_that_differ_in_figures_are_one_kind() {
        let rejected: Vec<Rejected> = [
            "cut off at the picture's border",
            "too small: 2.1 px",
            "ring pattern 0101 is no ring14 code: partly covered?",
            "too small: 3.0 px",
        ]
        .map(|reason| Rejected {
            place_px: Vector2::zeros(),
            reason: reason.into(),
        })
        .to_vec();
        let (kinds, of_each) = reason_kinds(&rejected);
        let told: Vec<(char, &str, usize)> = kinds
            .iter()
            .map(|kind| (kind.letter, kind.words.as_str(), kind.count))
            .collect();
        assert_eq!(
            told,
            [
                ('a', "too small", 2),
                ('b', "cut off at the picture's border", 1),
                ('c', "ring pattern # is no ring# code", 1),
            ]
        );
        assert_eq!(of_each, [1, 0, 2, 0]);
    }

    #[test]
    fn lines_break_between_words() {
        assert_eq!(
            wrapped("partly covered or not round", 14),
            ["partly covered", "or not round"]
        );
        assert_eq!(
            wrapped("incomprehensible it is", 6),
            ["incomprehensible", "it is"]
        );
        assert!(wrapped("", 6).is_empty());
    }
}
