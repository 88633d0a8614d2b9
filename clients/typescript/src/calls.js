/** The requests of a session. Made by scripts/client_calls.py from the description of the session; do not edit. */

/** @import * as m from "../types/messages.js" */

/** The messages of a session that are answered; each rejects with `Refused` or `Lost`. */
export class Calls {
  /** The materials by place. */
  layout = new Layout(this);

  /**
   * Send a message and return its answer; undefined fields are left out.
   * @param {string} type
   * @param {object} [fields]
   * @returns {Promise<any>}
   */
  async ask(type, fields) {
    throw new Error(`${type} ${fields}: expected a connection`);
  }

  /** Ask for the lease on the output; with `takeover` also from who holds it.
   * @param {m.Acquire["takeover"]} [takeover]
   * @returns {Promise<m.Lease>} */
  acquire(takeover = false) {
    return this.ask("acquire", { takeover });
  }

  /** Let touches be felt.
   * @returns {Promise<m.Output>} */
  arm() {
    return this.ask("arm");
  }

  /** End an effect by the number that `playing` gave.
   * @param {m.Cancel["effect_id"]} effectId
   * @returns {Promise<m.Done>} */
  cancel(effectId) {
    return this.ask("cancel", { effect_id: effectId });
  }

  /** Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.
   * @param {Omit<m.Geometry, "type" | "id">} fields
   * @returns {Promise<m.Done>} */
  geometry(fields) {
    return this.ask("geometry", fields);
  }

  /** Set the share of friction that is asked for, 0 to 1.
   * @param {m.Intensity["value"]} value
   * @returns {Promise<m.Output>} */
  intensity(value) {
    return this.ask("intensity", { value });
  }

  /** Ask which devices and profiles there are.
   * @returns {Promise<m.Inventory>} */
  inventory() {
    return this.ask("inventory");
  }

  /** Change the layout of this session: all of `ops`, or nothing.
   * @param {m.LayoutChange["ops"]} ops
   * @returns {Promise<m.LayoutReply>} */
  layoutChange(ops) {
    return this.ask("layout_change", { ops });
  }

  /** Replace the layout of this session by a document.
   * @param {m.LayoutSet["document"]} document
   * @returns {Promise<m.LayoutReply>} */
  layoutSet(document) {
    return this.ask("layout_set", { document });
  }

  /** Hold 0 V while time runs, until the lease ends.
   * @param {m.Switch["on"]} [on]
   * @returns {Promise<m.Output>} */
  mute(on = true) {
    return this.ask("mute", { on });
  }

  /** Hold 0 V while time stands, until the lease ends.
   * @param {m.Switch["on"]} [on]
   * @returns {Promise<m.Output>} */
  pause(on = true) {
    return this.ask("pause", { on });
  }

  /** Play an effect that ends, such as a transient; `effect_ended` reports its end.
   * @param {m.Play["effect"]} effect
   * @returns {Promise<m.Playing>} */
  play(effect) {
    return this.ask("play", { effect });
  }

  /** Give the lease back; 0 V first.
   * @returns {Promise<m.Done>} */
  release() {
    return this.ask("release");
  }

  /** Learn the finger by the current that it draws, from the next `arm` on.
   * @param {m.Switch["on"]} [on]
   * @returns {Promise<m.Output>} */
  sense(on = true) {
    return this.ask("sense", { on });
  }

  /** End at 0 V, whoever holds the output; the holder keeps the lease.
   * @returns {Promise<m.Done>} */
  stop() {
    return this.ask("stop");
  }

  /** Ask for streams, each with its highest rate in hertz; 0 ends one.
   * @param {m.Subscribe["streams"]} streams
   * @returns {Promise<m.Subscribed>} */
  subscribe(streams) {
    return this.ask("subscribe", { streams });
  }

  /** Request the progress of a job, and its changes until it ends.
   * @param {m.Watch["job"]} job
   * @returns {Promise<m.Job>} */
  watch(job) {
    return this.ask("watch", { job });
  }
}

/** The materials by place; the service keeps it for who connects again. */
export class Layout {
  #calls;
  #count = 0;

  /** @param {Calls} calls */
  constructor(calls) {
    this.#calls = calls;
  }

  /**
   * Add a region. Millimetres from the screen's corner; without a size it is as large as its material. The
   * name, for `contact.region`, is made where none is given.
   * @param {m.AddRegion["material"]} material
   * @param {Omit<m.AddRegion, "op" | "name" | "material"> & {name?: string}} [fields]
   * @returns {Promise<Region>}
   */
  async add(material, { name, ...fields } = {}) {
    this.#count += 1;
    const region = new Region(this.#calls, name || `region ${this.#count}`);
    await this.#calls.layoutChange([{ op: "add", name: region.name, material, ...fields }]);
    return region;
  }

  /** Remove all regions. */
  clear() {
    return this.#calls.layoutSet({ regions: [] });
  }
}

/**
 * A region of the layout, by its name; each call is one change.
 * @template {Calls} [S=Calls]
 */
export class Region {
  /** @param {S} session @param {string} name */
  constructor(session, name) {
    this.session = session;
    this.name = name;
  }

  /** Change the given fields of a region, in a cross-fade.
   * @param {Omit<m.ChangeRegion, "op" | "name">} [fields]
   * @returns {Promise<m.LayoutReply>} */
  change(fields = {}) {
    return this.session.layoutChange([{ op: "change", name: this.name, ...fields }]);
  }

  /** Move a region within `over_s`; fields that are left out stay.
   * @param {Omit<m.MoveRegion, "op" | "name">} [fields]
   * @returns {Promise<m.LayoutReply>} */
  move(fields = {}) {
    return this.session.layoutChange([{ op: "move", name: this.name, ...fields }]);
  }

  /** Remove a region; it fades out.
   * @returns {Promise<m.LayoutReply>} */
  remove() {
    return this.session.layoutChange([{ op: "remove", name: this.name }]);
  }

  /** Set the value of a control, such as a slider; it comes after all other changes.
   * @param {m.SetValue["value"]} value
   * @returns {Promise<m.LayoutReply>} */
  setValue(value) {
    return this.session.layoutChange([{ op: "value", name: this.name, value }]);
  }
}
