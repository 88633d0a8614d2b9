// Made by scripts/make-client-types.py from the schema of the messages; do not edit.
namespace Haptix.Messages
{
    using System;
    using System.Collections.Generic;

    using System.Globalization;
    using Newtonsoft.Json;
    using Newtonsoft.Json.Converters;

    /// <summary>
    /// Ask for the lease on the output; with `takeover` also from who holds it.
    /// </summary>
    public partial class Acquire
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("takeover", NullValueHandling = NullValueHandling.Ignore)]
        public bool? Takeover { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// The server ends the session, and says why.
    /// </summary>
    public partial class Bye
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("reason")]
        public string Reason { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// End an effect by the number that `playing` gave.
    /// </summary>
    public partial class Cancel
    {
        [JsonProperty("effect_id")]
        public long EffectId { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// A finger entered, left, pressed or released a region, or crossed a detent.
    /// </summary>
    public partial class Contact
    {
        [JsonProperty("event")]
        public string Event { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("region")]
        public string Region { get; set; }

        [JsonProperty("t_s")]
        public double TS { get; set; }

        [JsonProperty("touch_id")]
        public long TouchId { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }

        [JsonProperty("value")]
        public double? Value { get; set; }
    }

    /// <summary>
    /// What was asked is done.
    /// </summary>
    public partial class Done
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// An effect has ended: played whole, cut, or dropped.
    /// </summary>
    public partial class EffectEnded
    {
        [JsonProperty("effect_id")]
        public long EffectId { get; set; }

        [JsonProperty("felt_share")]
        public double FeltShare { get; set; }

        [JsonProperty("how")]
        public string How { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("sample")]
        public long Sample { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// A message was refused, and nothing changed by it.
    /// </summary>
    public partial class Error
    {
        [JsonProperty("code")]
        public string Code { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("path")]
        public string Path { get; set; }

        [JsonProperty("sentence")]
        public string Sentence { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Pixels to millimetres: ``mm = origin + turn(rotation) (px / px_per_mm)``.
    /// </summary>
    public partial class Geometry
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("origin_mm", NullValueHandling = NullValueHandling.Ignore)]
        public double[] OriginMm { get; set; }

        [JsonProperty("px_per_mm")]
        public double PxPerMm { get; set; }

        [JsonProperty("rotation_deg", NullValueHandling = NullValueHandling.Ignore)]
        public double? RotationDeg { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// First message: who comes, in which version.
    /// </summary>
    public partial class Hello
    {
        [JsonProperty("client")]
        public string Client { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("protocol")]
        public string Protocol { get; set; }

        [JsonProperty("resume", NullValueHandling = NullValueHandling.Ignore)]
        public string Resume { get; set; }

        [JsonProperty("token", NullValueHandling = NullValueHandling.Ignore)]
        public string Token { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Share of the asked friction, 0 to 1.
    /// </summary>
    public partial class Intensity
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }

        [JsonProperty("value")]
        public double Value { get; set; }
    }

    /// <summary>
    /// A job: how far it is, what it asks, why it failed, or what it found.
    /// </summary>
    public partial class Job
    {
        [JsonProperty("choices")]
        public string[] Choices { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("job")]
        public string JobJob { get; set; }

        [JsonProperty("kind")]
        public string Kind { get; set; }

        [JsonProperty("prompt")]
        public string Prompt { get; set; }

        [JsonProperty("result")]
        public Dictionary<string, object> Result { get; set; }

        [JsonProperty("sentence")]
        public string Sentence { get; set; }

        [JsonProperty("share")]
        public double Share { get; set; }

        [JsonProperty("state")]
        public string State { get; set; }

        [JsonProperty("step")]
        public string Step { get; set; }

        [JsonProperty("trace")]
        public StrokeTrace Trace { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// What a calibration's instruments read of a stroke, since they were told of last.
    /// </summary>
    public partial class StrokeTrace
    {
        [JsonProperty("asked_normal_force_n")]
        public double AskedNormalForceN { get; set; }

        [JsonProperty("asked_speed_mm_per_s")]
        public double AskedSpeedMmPerS { get; set; }

        [JsonProperty("normal_force_n")]
        public double[] NormalForceN { get; set; }

        [JsonProperty("speed_mm_per_s")]
        public double[] SpeedMmPerS { get; set; }

        [JsonProperty("stroke")]
        public long Stroke { get; set; }

        [JsonProperty("t_s")]
        public double[] TS { get; set; }

        [JsonProperty("tangential_force_n")]
        public double[] TangentialForceN { get; set; }

        [JsonProperty("tries")]
        public long Tries { get; set; }
    }

    /// <summary>
    /// The layout's revision, and the sample from which it is played, where one plays.
    /// </summary>
    public partial class LayoutReply
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("revision")]
        public long Revision { get; set; }

        [JsonProperty("sample")]
        public long? Sample { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Asks for a `pong` at once.
    /// </summary>
    public partial class Ping
    {
        [JsonProperty("clock_s")]
        public double ClockS { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("n")]
        public long N { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// A message without fields.
    /// </summary>
    public partial class Plain
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Play an effect that ends, such as a transient, for all fingers.
    /// </summary>
    public partial class Play
    {
        [JsonProperty("effect")]
        public Dictionary<string, object> Effect { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// An effect has begun; `effect_ended` follows with the same number.
    /// </summary>
    public partial class Playing
    {
        [JsonProperty("effect_id")]
        public long EffectId { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Answer to `ping`: its number, and the client's own clock.
    /// </summary>
    public partial class Pong
    {
        [JsonProperty("clock_s")]
        public double ClockS { get; set; }

        [JsonProperty("n")]
        public long N { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Streams that the client wants, each with its highest rate in hertz; 0 ends one.
    /// </summary>
    public partial class Subscribe
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("streams")]
        public Dictionary<string, double> Streams { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// The columns of each stream that is sent.
    /// </summary>
    public partial class Subscribed
    {
        [JsonProperty("columns")]
        public Dictionary<string, string[]> Columns { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Mute: 0 V while time runs. Pause: 0 V and time stands.
    /// </summary>
    public partial class Switch
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("on")]
        public bool On { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Touches as JSON; many are better sent as a batch of bytes.
    /// </summary>
    public partial class Touches
    {
        [JsonProperty("id")]
        public long? Id { get; set; }

        [JsonProperty("touches")]
        public Touch[] TouchesTouches { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// One report of one finger; its place is in millimetres or in pixels.
    /// </summary>
    public partial class Touch
    {
        [JsonProperty("contact_area_m2")]
        public double? ContactAreaM2 { get; set; }

        [JsonProperty("kind", NullValueHandling = NullValueHandling.Ignore)]
        public string Kind { get; set; }

        [JsonProperty("normal_force_n")]
        public double? NormalForceN { get; set; }

        [JsonProperty("t_s")]
        public double TS { get; set; }

        [JsonProperty("touch_id", NullValueHandling = NullValueHandling.Ignore)]
        public long? TouchId { get; set; }

        [JsonProperty("x_mm")]
        public double? XMm { get; set; }

        [JsonProperty("x_px")]
        public double? XPx { get; set; }

        [JsonProperty("y_mm")]
        public double? YMm { get; set; }

        [JsonProperty("y_px")]
        public double? YPx { get; set; }
    }

    /// <summary>
    /// Something that needs no answer but a look.
    /// </summary>
    public partial class Warning
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("sentence")]
        public string Sentence { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Ask how far a job is, and be told of its changes until it ends.
    /// </summary>
    public partial class Watch
    {
        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("job")]
        public string Job { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// Answer to `hello`.
    /// </summary>
    public partial class Welcome
    {
        [JsonProperty("clock_s")]
        public double ClockS { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("inventory")]
        public Inventory Inventory { get; set; }

        [JsonProperty("keep_alive")]
        public KeepAlive KeepAlive { get; set; }

        [JsonProperty("lease")]
        public Lease Lease { get; set; }

        [JsonProperty("limits")]
        public Limits Limits { get; set; }

        [JsonProperty("output")]
        public Output Output { get; set; }

        [JsonProperty("protocol")]
        public string Protocol { get; set; }

        [JsonProperty("resume")]
        public string Resume { get; set; }

        [JsonProperty("server")]
        public string Server { get; set; }

        [JsonProperty("session")]
        public long Session { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// All there is, whole each time.
    /// </summary>
    public partial class Inventory
    {
        [JsonProperty("devices")]
        public Device[] Devices { get; set; }

        [JsonProperty("finger")]
        public string Finger { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("kinds")]
        public string[] Kinds { get; set; }

        [JsonProperty("screen")]
        public string Screen { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// A driver: its address, what it is, and the profile that belongs to it.
    /// </summary>
    public partial class Device
    {
        [JsonProperty("address")]
        public string Address { get; set; }

        [JsonProperty("is_real")]
        public bool IsReal { get; set; }

        [JsonProperty("name")]
        public string Name { get; set; }
    }

    /// <summary>
    /// How often the server pings [s], and what becomes of a client that does not answer.
    /// </summary>
    public partial class KeepAlive
    {
        [JsonProperty("armed_s")]
        public double ArmedS { get; set; }

        [JsonProperty("close_s")]
        public double CloseS { get; set; }

        [JsonProperty("free_s")]
        public double FreeS { get; set; }

        [JsonProperty("idle_s")]
        public double IdleS { get; set; }

        [JsonProperty("silent_s")]
        public double SilentS { get; set; }
    }

    /// <summary>
    /// Who holds the output.
    /// </summary>
    public partial class Lease
    {
        [JsonProperty("holder")]
        public long? Holder { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("is_mine")]
        public bool IsMine { get; set; }

        [JsonProperty("reason")]
        public string Reason { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }

    /// <summary>
    /// What a session is held to.
    /// </summary>
    public partial class Limits
    {
        [JsonProperty("asset_bytes")]
        public long AssetBytes { get; set; }

        [JsonProperty("assets_bytes")]
        public long AssetsBytes { get; set; }

        [JsonProperty("batch_touches")]
        public long BatchTouches { get; set; }

        [JsonProperty("batches_per_s")]
        public long BatchesPerS { get; set; }

        [JsonProperty("depth")]
        public long Depth { get; set; }

        [JsonProperty("effects")]
        public long Effects { get; set; }

        [JsonProperty("fingers")]
        public long Fingers { get; set; }

        [JsonProperty("image_pixels")]
        public long ImagePixels { get; set; }

        [JsonProperty("messages_per_s")]
        public long MessagesPerS { get; set; }

        [JsonProperty("regions")]
        public long Regions { get; set; }

        [JsonProperty("text_bytes")]
        public long TextBytes { get; set; }

        [JsonProperty("touches_per_s")]
        public long TouchesPerS { get; set; }
    }

    /// <summary>
    /// What the output does. `voltage_share` is of the highest voltage; volts are not told.
    /// </summary>
    public partial class Output
    {
        [JsonProperty("device")]
        public string Device { get; set; }

        [JsonProperty("id")]
        public long Id { get; set; }

        [JsonProperty("intensity")]
        public double Intensity { get; set; }

        [JsonProperty("muted")]
        public bool Muted { get; set; }

        [JsonProperty("paused")]
        public bool Paused { get; set; }

        [JsonProperty("reason")]
        public string Reason { get; set; }

        [JsonProperty("state")]
        public string State { get; set; }

        [JsonProperty("type")]
        public string Type { get; set; }
    }
}
