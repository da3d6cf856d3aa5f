//! Reports: what the other modules compute, as pictures, sentences and pages.
//!
//! [`html`] makes a self-contained page from a document; [`figure`] draws diagrams, [`curves`] the
//! course of a simulated run, [`angles`] what the gimbals' angles mean on a stand; [`words`] are shared with the command line, and are there without the
//! feature `report` too.

#[cfg(feature = "report")]
pub mod angles;
#[cfg(feature = "report")]
pub mod curves;
#[cfg(feature = "report")]
pub mod figure;
#[cfg(feature = "report")]
pub mod html;
pub mod words;
