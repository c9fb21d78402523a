//! x
mod common;
#[test]
fn a() { common::measured(); }
