//! graintrain-tt
