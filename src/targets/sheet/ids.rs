//! Code numbers as a user writes them: `1-32,40`.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Numbers and ranges of numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdList {
    ranges: Vec<RangeInclusive<u32>>,
}

impl IdList {
    /// All numbers, rising, each once; the first one above `largest` or below 1 where there is one.
    ///
    /// # Errors
    /// The number that is none of 1 to `largest`.
    pub fn numbers(&self, largest: u32) -> Result<Vec<u32>, u32> {
        let mut numbers = BTreeSet::new();
        for range in &self.ranges {
            // Ends first: a range may be far longer than any family.
            for end in [*range.start(), *range.end()] {
                if !(1..=largest).contains(&end) {
                    return Err(end);
                }
            }
            numbers.extend(range.clone());
        }
        Ok(numbers.into_iter().collect())
    }
}

impl Default for IdList {
    /// 1 to 32.
    fn default() -> Self {
        Self {
            ranges: vec![1..=32],
        }
    }
}

impl fmt::Display for IdList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, range) in self.ranges.iter().enumerate() {
            let comma = if place == 0 { "" } else { "," };
            match (range.start(), range.end()) {
                (start, end) if start == end => write!(f, "{comma}{start}")?,
                (start, end) => write!(f, "{comma}{start}-{end}")?,
            }
        }
        Ok(())
    }
}

/// A text that is no list of code numbers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found '{0}', expected numbers and rising ranges such as 1-32,40")]
pub struct UnreadableIds(String);

impl FromStr for IdList {
    type Err = UnreadableIds;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let ranges = text
            .split(',')
            .map(|part| range(part).ok_or_else(|| UnreadableIds(part.trim().to_owned())))
            .collect::<Result<_, _>>()?;
        Ok(Self { ranges })
    }
}

fn range(part: &str) -> Option<RangeInclusive<u32>> {
    let number = |text: &str| text.trim().parse::<u32>().ok();
    let (start, end) = match part.split_once('-') {
        Some((start, end)) => (number(start)?, number(end)?),
        None => (number(part)?, number(part)?),
    };
    (start <= end).then_some(start..=end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_numbers_are_read_each_once() {
        let ids: IdList = "5-7, 40,6-8".parse().unwrap();
        assert_eq!(ids.numbers(420), Ok(vec![5, 6, 7, 8, 40]));
        assert_eq!(ids.to_string(), "5-7,40,6-8");
        assert_eq!(IdList::default().numbers(147).unwrap().len(), 32);
    }

    #[test]
    fn numbers_outside_the_family_are_named() {
        for (text, named) in [("1-421", 421), ("0", 0), ("7,4000000000", 4_000_000_000)] {
            assert_eq!(text.parse::<IdList>().unwrap().numbers(420), Err(named));
        }
    }

    #[test]
    fn other_texts_are_refused() {
        for text in ["", "1-", "a", "3-1", "1,,2", "1.5", "-3", "1-2-3"] {
            assert!(text.parse::<IdList>().is_err(), "{text}");
        }
    }
}
