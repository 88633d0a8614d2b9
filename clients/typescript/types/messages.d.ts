/* Made by `make clients` from the schema of the messages; do not edit. */

export type Message = ClientMessage | ServerMessage;
export type ClientMessage =
  | Hello
  | Acquire
  | Plain
  | Geometry
  | Touches
  | LayoutSet
  | LayoutChange
  | Play
  | Cancel
  | Intensity
  | Switch
  | Subscribe
  | Watch
  | Pong;
export type ServerMessage =
  | Welcome
  | Lease
  | Output
  | Inventory
  | Done
  | LayoutReply
  | Playing
  | EffectEnded
  | Contact
  | Subscribed
  | Job
  | Ping
  | Warning
  | Error
  | Bye;

/** First message: who comes, in which version. */
export interface Hello {
  type: "hello";
  id: number;
  protocol: string;
  client: string;
  token?: string;
  resume?: string;
  app?: string;
}
/** Ask for the lease on the output; with `takeover` also from who holds it. */
export interface Acquire {
  type: "acquire";
  id: number;
  takeover?: boolean;
}
/** A message without fields. */
export interface Plain {
  type: "release" | "arm" | "stop" | "inventory" | "bye";
  id: number;
}
/** Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``. */
export interface Geometry {
  px_per_mm: number;
  origin_mm?: number[];
  rotation_deg?: number;
  type: "geometry";
  id: number;
}
/** Touches as JSON; many are better sent as a batch of bytes. */
export interface Touches {
  type: "touch";
  id?: number | null;
  touches: Touch[];
}
/** One report of one finger; its place is in millimetres or in pixels. */
export interface Touch {
  t_s: number;
  touch_id?: number;
  kind?: "down" | "move" | "up";
  x_mm?: number | null;
  y_mm?: number | null;
  x_px?: number | null;
  y_px?: number | null;
  normal_force_n?: number | null;
  contact_area_m2?: number | null;
}
/** Replace the layout of this session by a document. */
export interface LayoutSet {
  type: "layout_set";
  id: number;
  document: LayoutDocument;
}
/** All regions; beside them nothing is felt. */
export interface LayoutDocument {
  regions: RegionDocument[];
}
/** A region: its name, its material's document, and where it lies. */
export interface RegionDocument {
  x_mm?: number | null;
  y_mm?: number | null;
  rotation_deg?: number | null;
  width_mm?: number | null;
  height_mm?: number | null;
  shape?: ("rectangle" | "ellipse") | number[][] | null;
  scale?: number | null;
  z?: number | null;
  blend?: ("over" | "add" | "multiply" | "max" | "min") | null;
  opacity?: number | null;
  priority?: number | null;
  group?: string | null;
  name: string;
  material: import("./materials.js").Material;
}
/** Change the layout of this session: all of `ops`, or nothing. */
export interface LayoutChange {
  type: "layout_change";
  id: number;
  ops: (AddRegion | ChangeRegion | MoveRegion | RemoveRegion | SetValue)[];
}
/** Add a region. */
export interface AddRegion {
  x_mm?: number | null;
  y_mm?: number | null;
  rotation_deg?: number | null;
  width_mm?: number | null;
  height_mm?: number | null;
  shape?: ("rectangle" | "ellipse") | number[][] | null;
  scale?: number | null;
  z?: number | null;
  blend?: ("over" | "add" | "multiply" | "max" | "min") | null;
  opacity?: number | null;
  priority?: number | null;
  group?: string | null;
  name: string;
  material: import("./materials.js").Material;
  op: "add";
}
/** Change the given fields of a region, in a cross-fade. */
export interface ChangeRegion {
  x_mm?: number | null;
  y_mm?: number | null;
  rotation_deg?: number | null;
  width_mm?: number | null;
  height_mm?: number | null;
  shape?: ("rectangle" | "ellipse") | number[][] | null;
  scale?: number | null;
  z?: number | null;
  blend?: ("over" | "add" | "multiply" | "max" | "min") | null;
  opacity?: number | null;
  priority?: number | null;
  group?: string | null;
  op: "change";
  name: string;
  material?: import("./materials.js").Material | null;
}
/** Move a region within `over_s`; fields that are left out stay. */
export interface MoveRegion {
  x_mm?: number | null;
  y_mm?: number | null;
  rotation_deg?: number | null;
  op: "move";
  name: string;
  over_s?: number;
}
/** Remove a region; it fades out. */
export interface RemoveRegion {
  op: "remove";
  name: string;
}
/** Set the value of a control, such as a slider; it comes after all other changes. */
export interface SetValue {
  op: "value";
  name: string;
  value: number;
}
/** Play an effect that ends, such as a transient; `effect_ended` reports its end. */
export interface Play {
  type: "play";
  id: number;
  effect: import("./materials.js").Material;
}
/** End an effect by the number that `playing` gave. */
export interface Cancel {
  type: "cancel";
  id: number;
  effect_id: number;
}
/** Set the share of friction that is asked for, 0 to 1. */
export interface Intensity {
  type: "intensity";
  id: number;
  value: number;
}
/** Mute: 0 V while time runs. Pause: 0 V and time stands. Sense: by the current, once armed. */
export interface Switch {
  type: "mute" | "pause" | "sense";
  id: number;
  on?: boolean;
}
/** Ask for streams, each with its highest rate in hertz; 0 ends one. */
export interface Subscribe {
  type: "subscribe";
  id: number;
  streams: {
    [k: string]: number;
  };
}
/** Request the progress of a job, and its changes until it ends. */
export interface Watch {
  type: "watch";
  id: number;
  job: string;
}
/** Answer to `ping`: its number, and the client's own clock. */
export interface Pong {
  type: "pong";
  n: number;
  clock_s: number;
}
/** Answer to `hello`. */
export interface Welcome {
  type: "welcome";
  id: number;
  protocol: string;
  server: string;
  session: number;
  resume: string;
  limits: Limits;
  keep_alive: KeepAlive;
  clock_s: number;
  inventory: Inventory;
  output: Output;
  lease: Lease;
}
/** Limits of a session. */
export interface Limits {
  text_bytes: number;
  depth: number;
  batch_touches: number;
  fingers: number;
  messages_per_s: number;
  batches_per_s: number;
  touches_per_s: number;
  regions: number;
  effects: number;
  asset_bytes: number;
  assets_bytes: number;
  image_pixels: number;
}
/** How often the server pings [s], and what becomes of a client that does not answer. */
export interface KeepAlive {
  armed_s: number;
  idle_s: number;
  silent_s: number;
  free_s: number;
  close_s: number;
}
/** All there is, whole each time. */
export interface Inventory {
  type: "inventory";
  id: number;
  devices: Device[];
  finger: string;
  screen: string;
  screen_mm: number[];
  kinds: string[];
}
/** A driver: its address, its description, and its profile. */
export interface Device {
  address: string;
  name: string;
  is_real: boolean;
}
/**
 * State of the output. `intensity`, `muted` and `paused` are its holder's.
 *
 * `failed`: the driver or the engine failed, and `arm` may be tried. `gone`: the driver does not
 * answer, and is looked for. `back`: it was opened again, and a person arms it; a virtual one is
 * armed by itself.
 *
 * While a job plays, `lent_to` is its kind, and `state` is that of all others: off.
 */
export interface Output {
  type: "output";
  id: number;
  state: "off" | "armed" | "asleep" | "failed" | "gone" | "back";
  device: string;
  intensity: number;
  muted: boolean;
  paused: boolean;
  senses: boolean;
  person_intensity: number;
  person_muted: boolean;
  lent_to: string;
  reason: string;
}
/** Who holds the output. */
export interface Lease {
  type: "lease";
  id: number;
  holder: number | null;
  is_mine: boolean;
  reason: string;
}
/** The request was carried out. */
export interface Done {
  type: "done";
  id: number;
}
/** The layout's revision. */
export interface LayoutReply {
  type: "layout";
  id: number;
  revision: number;
}
/** An effect has begun; `effect_ended` follows with the same number. */
export interface Playing {
  type: "playing";
  id: number;
  effect_id: number;
}
/** An effect has ended: played whole, cut, or dropped. */
export interface EffectEnded {
  type: "effect_ended";
  id: number;
  effect_id: number;
  how: "played" | "cut" | "dropped";
  sample: number;
  felt_share: number;
}
/** A finger entered, left, pressed or released a region, or crossed a detent. */
export interface Contact {
  type: "contact";
  id: number;
  event: "enter" | "leave" | "press" | "release" | "detent";
  region: string;
  touch_id: number;
  t_s: number;
  value: number | null;
}
/** The columns of each stream that is sent. */
export interface Subscribed {
  type: "subscribed";
  id: number;
  columns: {
    [k: string]: string[];
  };
}
/** A job: its progress, its question, its error or its result. */
export interface Job {
  type: "job";
  id: number;
  job: string;
  kind: string;
  state: "queued" | "running" | "asking" | "done" | "failed" | "cancelled";
  share: number;
  prompt: string;
  choices: string[];
  sentence: string;
  step: string;
  trace: StrokeTrace | null;
  result: {
    [k: string]: unknown;
  } | null;
}
/** Readings of a calibration's instruments in a stroke since the last such message. */
export interface StrokeTrace {
  stroke: number;
  tries: number;
  asked_normal_force_n: number;
  asked_speed_mm_per_s: number;
  t_s: number[];
  normal_force_n: number[];
  tangential_force_n: number[];
  speed_mm_per_s: number[];
}
/** Asks for a `pong` at once. */
export interface Ping {
  type: "ping";
  id: number;
  n: number;
  clock_s: number;
}
/** Something that needs no answer but a look. */
export interface Warning {
  type: "warning";
  id: number;
  sentence: string;
}
/** A message was refused, and nothing changed by it. */
export interface Error {
  type: "error";
  id: number;
  code:
    | "message"
    | "version"
    | "order"
    | "stale"
    | "access"
    | "lease"
    | "clock"
    | "limit"
    | "document"
    | "device"
    | "unknown"
    | "internal";
  sentence: string;
  path: string;
}
/** The server ends the session, with the reason. */
export interface Bye {
  type: "bye";
  id: number;
  reason: string;
}
