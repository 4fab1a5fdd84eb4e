// The built-in scenes that playground and gallery offer, at sizes that a browser runs in seconds. Their files come from the program.
// `picture` is what `graintrain render` is asked for.
export const SCENES = [
  { name: "sedimentation", title: "Sedimentation with a mixer", set: { n: 3 }, picture: ["--time", "1.5"] },
  { name: "drafting", title: "A blade through grains", set: { n: 3 }, picture: ["--force-chains"] },
  { name: "excavator", title: "An excavator digs", set: { rows: 12, columns: 4, layers: 4 }, picture: ["--time", "2.6"] },
  { name: "hopper", title: "A hopper runs out", set: {}, picture: ["--time", "1"] },
  { name: "repose", title: "Angle of repose", set: { count: 300 }, picture: ["--color", "radius"] },
  { name: "shear-box", title: "Direct shear", set: { n: 4 }, picture: ["--force-chains"] },
  { name: "passive-wall", title: "Passive earth pressure", set: { along: 14, across: 5, high: 12 }, picture: ["--force-chains"] },
  { name: "silo", title: "A silo after Janssen", set: { grains: 300 }, picture: ["--color", "force"] },
  { name: "stack", title: "A stack of boxes", set: {}, picture: ["--color", "force"] },
  { name: "incline", title: "A block on a slope", set: {}, picture: ["--time", "0.5"] },
];
