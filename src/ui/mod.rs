//! The window: the only place that knows egui, eframe and wgpu.
//!
//! A panel draws and asks: `fn ui(&mut self, ui, context, actions: &mut Vec<Action>)`. One place applies the actions
//! after the frame. No frame waits for a disk or for computation: steps run on one worker, pictures are decoded on
//! another, and what is drawn is cached by `Arc::ptr_eq` on the document.

pub mod action;
pub mod app;
pub mod context;
pub mod format;
pub mod image_view;
pub mod layout;
pub mod network_view;
pub mod panels;
pub mod pictures;
pub mod runner;
pub mod theme;
pub mod window;
