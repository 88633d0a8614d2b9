// Made by `make clients` from the schema of the messages; do not edit.
namespace Haptix.Messages
{
    using System;
    using System.Collections.Generic;

    using System.Globalization;
    using Newtonsoft.Json;
    using Newtonsoft.Json.Converters;

    /// <summary>Ask for the lease on the output; with `takeover` also from who holds it.</summary>
    [Preserve] public partial class Acquire
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("takeover", NullValueHandling = NullValueHandling.Ignore)] public bool? Takeover { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Add a region.</summary>
    [Preserve] public partial class AddRegion
    {
        [Preserve, JsonProperty("blend")] public string Blend { get; set; }
        [Preserve, JsonProperty("group")] public string Group { get; set; }
        [Preserve, JsonProperty("height_mm")] public double? HeightMm { get; set; }
        [Preserve, JsonProperty("material")] public object Material { get; set; }
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("op")] public string Op { get; set; }
        [Preserve, JsonProperty("opacity")] public double? Opacity { get; set; }
        [Preserve, JsonProperty("priority")] public long? Priority { get; set; }
        [Preserve, JsonProperty("rotation_deg")] public double? RotationDeg { get; set; }
        [Preserve, JsonProperty("scale")] public double? Scale { get; set; }
        [Preserve, JsonProperty("shape")] public object Shape { get; set; }
        [Preserve, JsonProperty("width_mm")] public double? WidthMm { get; set; }
        [Preserve, JsonProperty("x_mm")] public double? XMm { get; set; }
        [Preserve, JsonProperty("y_mm")] public double? YMm { get; set; }
        [Preserve, JsonProperty("z")] public double? Z { get; set; }
    }

    /// <summary>The server ends the session, with the reason.</summary>
    [Preserve] public partial class Bye
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("reason")] public string Reason { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>End an effect by the number that `playing` gave.</summary>
    [Preserve] public partial class Cancel
    {
        [Preserve, JsonProperty("effect_id")] public long EffectId { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Change the given fields of a region, in a cross-fade.</summary>
    [Preserve] public partial class ChangeRegion
    {
        [Preserve, JsonProperty("blend")] public string Blend { get; set; }
        [Preserve, JsonProperty("group")] public string Group { get; set; }
        [Preserve, JsonProperty("height_mm")] public double? HeightMm { get; set; }
        [Preserve, JsonProperty("material")] public object Material { get; set; }
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("op")] public string Op { get; set; }
        [Preserve, JsonProperty("opacity")] public double? Opacity { get; set; }
        [Preserve, JsonProperty("priority")] public long? Priority { get; set; }
        [Preserve, JsonProperty("rotation_deg")] public double? RotationDeg { get; set; }
        [Preserve, JsonProperty("scale")] public double? Scale { get; set; }
        [Preserve, JsonProperty("shape")] public object Shape { get; set; }
        [Preserve, JsonProperty("width_mm")] public double? WidthMm { get; set; }
        [Preserve, JsonProperty("x_mm")] public double? XMm { get; set; }
        [Preserve, JsonProperty("y_mm")] public double? YMm { get; set; }
        [Preserve, JsonProperty("z")] public double? Z { get; set; }
    }

    /// <summary>A finger entered, left, pressed or released a region, or crossed a detent.</summary>
    [Preserve] public partial class Contact
    {
        [Preserve, JsonProperty("event")] public string Event { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("region")] public string Region { get; set; }
        [Preserve, JsonProperty("t_s")] public double TS { get; set; }
        [Preserve, JsonProperty("touch_id")] public long TouchId { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
        [Preserve, JsonProperty("value")] public double? Value { get; set; }
    }

    /// <summary>The request was carried out.</summary>
    [Preserve] public partial class Done
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>An effect has ended: played whole, cut, or dropped.</summary>
    [Preserve] public partial class EffectEnded
    {
        [Preserve, JsonProperty("effect_id")] public long EffectId { get; set; }
        [Preserve, JsonProperty("felt_share")] public double FeltShare { get; set; }
        [Preserve, JsonProperty("how")] public string How { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("sample")] public long Sample { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>A message was refused, and nothing changed by it.</summary>
    [Preserve] public partial class Error
    {
        [Preserve, JsonProperty("code")] public string Code { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("path")] public string Path { get; set; }
        [Preserve, JsonProperty("sentence")] public string Sentence { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.</summary>
    [Preserve] public partial class Geometry
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("origin_mm", NullValueHandling = NullValueHandling.Ignore)] public double[] OriginMm { get; set; }
        [Preserve, JsonProperty("px_per_mm")] public double PxPerMm { get; set; }
        [Preserve, JsonProperty("rotation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? RotationDeg { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>First message: who comes, in which version.</summary>
    [Preserve] public partial class Hello
    {
        [Preserve, JsonProperty("app", NullValueHandling = NullValueHandling.Ignore)] public string App { get; set; }
        [Preserve, JsonProperty("client")] public string Client { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("protocol")] public string Protocol { get; set; }
        [Preserve, JsonProperty("resume", NullValueHandling = NullValueHandling.Ignore)] public string Resume { get; set; }
        [Preserve, JsonProperty("token", NullValueHandling = NullValueHandling.Ignore)] public string Token { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Set the share of friction that is asked for, 0 to 1.</summary>
    [Preserve] public partial class Intensity
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
        [Preserve, JsonProperty("value")] public double Value { get; set; }
    }

    /// <summary>A job: its progress, its question, its error or its result.</summary>
    [Preserve] public partial class Job
    {
        [Preserve, JsonProperty("choices")] public string[] Choices { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("job")] public string JobJob { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("prompt")] public string Prompt { get; set; }
        [Preserve, JsonProperty("result")] public object Result { get; set; }
        [Preserve, JsonProperty("sentence")] public string Sentence { get; set; }
        [Preserve, JsonProperty("share")] public double Share { get; set; }
        [Preserve, JsonProperty("state")] public string State { get; set; }
        [Preserve, JsonProperty("step")] public string Step { get; set; }
        [Preserve, JsonProperty("trace")] public StrokeTrace Trace { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Readings of a calibration's instruments in a stroke since the last such message.</summary>
    [Preserve] public partial class StrokeTrace
    {
        [Preserve, JsonProperty("asked_normal_force_n")] public double AskedNormalForceN { get; set; }
        [Preserve, JsonProperty("asked_speed_mm_per_s")] public double AskedSpeedMmPerS { get; set; }
        [Preserve, JsonProperty("normal_force_n")] public double[] NormalForceN { get; set; }
        [Preserve, JsonProperty("speed_mm_per_s")] public double[] SpeedMmPerS { get; set; }
        [Preserve, JsonProperty("stroke")] public long Stroke { get; set; }
        [Preserve, JsonProperty("t_s")] public double[] TS { get; set; }
        [Preserve, JsonProperty("tangential_force_n")] public double[] TangentialForceN { get; set; }
        [Preserve, JsonProperty("tries")] public long Tries { get; set; }
    }

    /// <summary>Change the layout of this session: all of `ops`, or nothing.</summary>
    [Preserve] public partial class LayoutChange
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("ops")] public object[] Ops { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>The layout's revision.</summary>
    [Preserve] public partial class LayoutReply
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("revision")] public long Revision { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Replace the layout of this session by a document.</summary>
    [Preserve] public partial class LayoutSet
    {
        [Preserve, JsonProperty("document")] public LayoutDocument Document { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>All regions; beside them nothing is felt.</summary>
    [Preserve] public partial class LayoutDocument
    {
        [Preserve, JsonProperty("regions")] public RegionDocument[] Regions { get; set; }
    }

    /// <summary>A region: its name, its material's document, and where it lies.</summary>
    [Preserve] public partial class RegionDocument
    {
        [Preserve, JsonProperty("blend")] public string Blend { get; set; }
        [Preserve, JsonProperty("group")] public string Group { get; set; }
        [Preserve, JsonProperty("height_mm")] public double? HeightMm { get; set; }
        [Preserve, JsonProperty("material")] public object Material { get; set; }
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("opacity")] public double? Opacity { get; set; }
        [Preserve, JsonProperty("priority")] public long? Priority { get; set; }
        [Preserve, JsonProperty("rotation_deg")] public double? RotationDeg { get; set; }
        [Preserve, JsonProperty("scale")] public double? Scale { get; set; }
        [Preserve, JsonProperty("shape")] public object Shape { get; set; }
        [Preserve, JsonProperty("width_mm")] public double? WidthMm { get; set; }
        [Preserve, JsonProperty("x_mm")] public double? XMm { get; set; }
        [Preserve, JsonProperty("y_mm")] public double? YMm { get; set; }
        [Preserve, JsonProperty("z")] public double? Z { get; set; }
    }

    /// <summary>Move a region within `over_s`; fields that are left out stay.</summary>
    [Preserve] public partial class MoveRegion
    {
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("op")] public string Op { get; set; }
        [Preserve, JsonProperty("over_s", NullValueHandling = NullValueHandling.Ignore)] public double? OverS { get; set; }
        [Preserve, JsonProperty("rotation_deg")] public double? RotationDeg { get; set; }
        [Preserve, JsonProperty("x_mm")] public double? XMm { get; set; }
        [Preserve, JsonProperty("y_mm")] public double? YMm { get; set; }
    }

    /// <summary>Asks for a `pong` at once.</summary>
    [Preserve] public partial class Ping
    {
        [Preserve, JsonProperty("clock_s")] public double ClockS { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("n")] public long N { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>A message without fields.</summary>
    [Preserve] public partial class Plain
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Play an effect that ends, such as a transient; `effect_ended` reports its end.</summary>
    [Preserve] public partial class Play
    {
        [Preserve, JsonProperty("effect")] public object Effect { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>An effect has begun; `effect_ended` follows with the same number.</summary>
    [Preserve] public partial class Playing
    {
        [Preserve, JsonProperty("effect_id")] public long EffectId { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Answer to `ping`: its number, and the client's own clock.</summary>
    [Preserve] public partial class Pong
    {
        [Preserve, JsonProperty("clock_s")] public double ClockS { get; set; }
        [Preserve, JsonProperty("n")] public long N { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Remove a region; it fades out.</summary>
    [Preserve] public partial class RemoveRegion
    {
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("op")] public string Op { get; set; }
    }

    /// <summary>Set the value of a control, such as a slider; it comes after all other changes.</summary>
    [Preserve] public partial class SetValue
    {
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("op")] public string Op { get; set; }
        [Preserve, JsonProperty("value")] public double Value { get; set; }
    }

    /// <summary>Ask for streams, each with its highest rate in hertz; 0 ends one.</summary>
    [Preserve] public partial class Subscribe
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("streams")] public Dictionary<string, double> Streams { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>The columns of each stream that is sent.</summary>
    [Preserve] public partial class Subscribed
    {
        [Preserve, JsonProperty("columns")] public Dictionary<string, string[]> Columns { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Mute: 0 V while time runs. Pause: 0 V and time stands. Sense: by the current, once armed.</summary>
    [Preserve] public partial class Switch
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("on", NullValueHandling = NullValueHandling.Ignore)] public bool? On { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Touches as JSON; many are better sent as a batch of bytes.</summary>
    [Preserve] public partial class Touches
    {
        [Preserve, JsonProperty("id")] public long? Id { get; set; }
        [Preserve, JsonProperty("touches")] public Touch[] TouchesTouches { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>One report of one finger; its place is in millimetres or in pixels.</summary>
    [Preserve] public partial class Touch
    {
        [Preserve, JsonProperty("contact_area_m2")] public double? ContactAreaM2 { get; set; }
        [Preserve, JsonProperty("kind", NullValueHandling = NullValueHandling.Ignore)] public string Kind { get; set; }
        [Preserve, JsonProperty("normal_force_n")] public double? NormalForceN { get; set; }
        [Preserve, JsonProperty("t_s")] public double TS { get; set; }
        [Preserve, JsonProperty("touch_id", NullValueHandling = NullValueHandling.Ignore)] public long? TouchId { get; set; }
        [Preserve, JsonProperty("x_mm")] public double? XMm { get; set; }
        [Preserve, JsonProperty("x_px")] public double? XPx { get; set; }
        [Preserve, JsonProperty("y_mm")] public double? YMm { get; set; }
        [Preserve, JsonProperty("y_px")] public double? YPx { get; set; }
    }

    /// <summary>Something that needs no answer but a look.</summary>
    [Preserve] public partial class Warning
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("sentence")] public string Sentence { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Request the progress of a job, and its changes until it ends.</summary>
    [Preserve] public partial class Watch
    {
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("job")] public string Job { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Answer to `hello`.</summary>
    [Preserve] public partial class Welcome
    {
        [Preserve, JsonProperty("clock_s")] public double ClockS { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("inventory")] public Inventory Inventory { get; set; }
        [Preserve, JsonProperty("keep_alive")] public KeepAlive KeepAlive { get; set; }
        [Preserve, JsonProperty("lease")] public Lease Lease { get; set; }
        [Preserve, JsonProperty("limits")] public Limits Limits { get; set; }
        [Preserve, JsonProperty("output")] public Output Output { get; set; }
        [Preserve, JsonProperty("protocol")] public string Protocol { get; set; }
        [Preserve, JsonProperty("resume")] public string Resume { get; set; }
        [Preserve, JsonProperty("server")] public string Server { get; set; }
        [Preserve, JsonProperty("session")] public long Session { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>All there is, whole each time.</summary>
    [Preserve] public partial class Inventory
    {
        [Preserve, JsonProperty("devices")] public Device[] Devices { get; set; }
        [Preserve, JsonProperty("finger")] public string Finger { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("kinds")] public string[] Kinds { get; set; }
        [Preserve, JsonProperty("screen")] public string Screen { get; set; }
        [Preserve, JsonProperty("screen_mm")] public double[] ScreenMm { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>A driver: its address, its description, and its profile.</summary>
    [Preserve] public partial class Device
    {
        [Preserve, JsonProperty("address")] public string Address { get; set; }
        [Preserve, JsonProperty("is_real")] public bool IsReal { get; set; }
        [Preserve, JsonProperty("name")] public string Name { get; set; }
    }

    /// <summary>How often the server pings [s], and what becomes of a client that does not answer.</summary>
    [Preserve] public partial class KeepAlive
    {
        [Preserve, JsonProperty("armed_s")] public double ArmedS { get; set; }
        [Preserve, JsonProperty("close_s")] public double CloseS { get; set; }
        [Preserve, JsonProperty("free_s")] public double FreeS { get; set; }
        [Preserve, JsonProperty("idle_s")] public double IdleS { get; set; }
        [Preserve, JsonProperty("silent_s")] public double SilentS { get; set; }
    }

    /// <summary>Who holds the output.</summary>
    [Preserve] public partial class Lease
    {
        [Preserve, JsonProperty("holder")] public long? Holder { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("is_mine")] public bool IsMine { get; set; }
        [Preserve, JsonProperty("reason")] public string Reason { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }

    /// <summary>Limits of a session.</summary>
    [Preserve] public partial class Limits
    {
        [Preserve, JsonProperty("asset_bytes")] public long AssetBytes { get; set; }
        [Preserve, JsonProperty("assets_bytes")] public long AssetsBytes { get; set; }
        [Preserve, JsonProperty("batch_touches")] public long BatchTouches { get; set; }
        [Preserve, JsonProperty("batches_per_s")] public long BatchesPerS { get; set; }
        [Preserve, JsonProperty("depth")] public long Depth { get; set; }
        [Preserve, JsonProperty("effects")] public long Effects { get; set; }
        [Preserve, JsonProperty("fingers")] public long Fingers { get; set; }
        [Preserve, JsonProperty("image_pixels")] public long ImagePixels { get; set; }
        [Preserve, JsonProperty("messages_per_s")] public long MessagesPerS { get; set; }
        [Preserve, JsonProperty("regions")] public long Regions { get; set; }
        [Preserve, JsonProperty("text_bytes")] public long TextBytes { get; set; }
        [Preserve, JsonProperty("touches_per_s")] public long TouchesPerS { get; set; }
    }

    /// <summary>
    /// State of the output. `intensity`, `muted` and `paused` are its holder's.
    ///
    /// `failed`: the driver or the engine failed, and `arm` may be tried. `gone`: the driver
    /// does not
    /// answer, and is looked for. `back`: it was opened again, and a person arms it; a virtual
    /// one is
    /// armed by itself.
    ///
    /// While a job plays, `lent_to` is its kind, and `state` is that of all others: off.
    /// </summary>
    [Preserve] public partial class Output
    {
        [Preserve, JsonProperty("device")] public string Device { get; set; }
        [Preserve, JsonProperty("id")] public long Id { get; set; }
        [Preserve, JsonProperty("intensity")] public double Intensity { get; set; }
        [Preserve, JsonProperty("lent_to")] public string LentTo { get; set; }
        [Preserve, JsonProperty("muted")] public bool Muted { get; set; }
        [Preserve, JsonProperty("paused")] public bool Paused { get; set; }
        [Preserve, JsonProperty("person_intensity")] public double PersonIntensity { get; set; }
        [Preserve, JsonProperty("person_muted")] public bool PersonMuted { get; set; }
        [Preserve, JsonProperty("reason")] public string Reason { get; set; }
        [Preserve, JsonProperty("senses")] public bool Senses { get; set; }
        [Preserve, JsonProperty("state")] public string State { get; set; }
        [Preserve, JsonProperty("type")] public string Type { get; set; }
    }
}
