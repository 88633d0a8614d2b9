// Made by `make clients` from the schema of the messages; do not edit.
namespace Haptix.Materials
{
    using System;
    using System.Collections.Generic;

    using System.Globalization;
    using Newtonsoft.Json;
    using Newtonsoft.Json.Converters;

    /// <summary>Values of a texture where the finger is: on the line y = 0, with all detail.</summary>
    [Preserve] public partial class AlongPath
    {
        [Preserve, JsonProperty("field")] public object Field { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>How the finger moves; a number is a steady speed [mm/s].</summary>
        [Preserve, JsonProperty("speed")] public object Speed { get; set; }
    }

    /// <summary>A button whose corner is the origin.</summary>
    [Preserve] public partial class Button
    {
        /// <summary>Size on the screen. What is left at its default is that of the region.</summary>
        [Preserve, JsonProperty("height_mm", NullValueHandling = NullValueHandling.Ignore)] public double? HeightMm { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>Normal forces at which it is pressed and let go.</summary>
        [Preserve, JsonProperty("press_n", NullValueHandling = NullValueHandling.Ignore)] public double? PressN { get; set; }
        /// <summary>Normal forces at which it is pressed and let go.</summary>
        [Preserve, JsonProperty("release_n", NullValueHandling = NullValueHandling.Ignore)] public double? ReleaseN { get; set; }
        /// <summary>Width of the rim, by which a sliding finger finds the button.</summary>
        [Preserve, JsonProperty("rim_mm", NullValueHandling = NullValueHandling.Ignore)] public double? RimMm { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Size on the screen. What is left at its default is that of the region.</summary>
        [Preserve, JsonProperty("width_mm", NullValueHandling = NullValueHandling.Ignore)] public double? WidthMm { get; set; }
    }

    /// <summary>Friction that depends on the normal force, measured or assumed.</summary>
    [Preserve] public partial class ByForce
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction coefficients instead.</summary>
        [Preserve, JsonProperty("mu")] public double[] Mu { get; set; }
        /// <summary>Corners of the curve [N].</summary>
        [Preserve, JsonProperty("normal_force_n")] public double[] NormalForceN { get; set; }
        /// <summary>Material that the curve multiplies.</summary>
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>At the corners: shares of the reachable range; with `of`, factors.</summary>
        [Preserve, JsonProperty("share")] public double[] Share { get; set; }
    }

    /// <summary>
    /// Friction that depends on the finger's speed: a surface that drags more, or slips, the
    /// faster.
    /// </summary>
    [Preserve] public partial class BySpeed
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction coefficients instead.</summary>
        [Preserve, JsonProperty("mu")] public double[] Mu { get; set; }
        /// <summary>Material that the curve multiplies.</summary>
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>At the corners: shares of the reachable range; with `of`, factors.</summary>
        [Preserve, JsonProperty("share")] public double[] Share { get; set; }
        /// <summary>Corners of the curve [mm/s].</summary>
        [Preserve, JsonProperty("speed_mm_s")] public double[] SpeedMmS { get; set; }
    }

    /// <summary>A sine whose frequency goes from `start_hz` to `end_hz`, linearly or by equal ratios.</summary>
    [Preserve] public partial class Chirp
    {
        /// <summary>Amplitude of the sine, and the value about which it swings.</summary>
        [Preserve, JsonProperty("amplitude")] public double Amplitude { get; set; }
        /// <summary>First and last frequency [Hz].</summary>
        [Preserve, JsonProperty("end_hz")] public double EndHz { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>"linear", or "logarithmic" for equal ratios in equal times.</summary>
        [Preserve, JsonProperty("law", NullValueHandling = NullValueHandling.Ignore)] public string Law { get; set; }
        [Preserve, JsonProperty("length_s")] public double LengthS { get; set; }
        /// <summary>Amplitude of the sine, and the value about which it swings.</summary>
        [Preserve, JsonProperty("offset", NullValueHandling = NullValueHandling.Ignore)] public double? Offset { get; set; }
        /// <summary>Phase at the start [rad].</summary>
        [Preserve, JsonProperty("phase_rad", NullValueHandling = NullValueHandling.Ignore)] public double? PhaseRad { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>First and last frequency [Hz].</summary>
        [Preserve, JsonProperty("start_hz")] public double StartHz { get; set; }
    }

    /// <summary>Signals one after the other.</summary>
    [Preserve] public partial class Concatenation
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("parts")] public object[] Parts { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>A constant value.</summary>
    [Preserve] public partial class Constant
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length [s]; endless if not given.</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>The value.</summary>
        [Preserve, JsonProperty("value")] public double Value { get; set; }
    }

    /// <summary>A knob: ridges across the way round, as wide at every radius.</summary>
    [Preserve] public partial class Dial
    {
        /// <summary>Its middle; in a region, from the region's corner.</summary>
        [Preserve, JsonProperty("centre_mm", NullValueHandling = NullValueHandling.Ignore)] public double[] CentreMm { get; set; }
        /// <summary>In a turn; the first is at 0 deg, to the right, the next ones from x towards y.</summary>
        [Preserve, JsonProperty("detents", NullValueHandling = NullValueHandling.Ignore)] public long? Detents { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        /// <summary>Radii between which there are ridges.</summary>
        [Preserve, JsonProperty("inner_mm", NullValueHandling = NullValueHandling.Ignore)] public double? InnerMm { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>Radii between which there are ridges.</summary>
        [Preserve, JsonProperty("outer_mm", NullValueHandling = NullValueHandling.Ignore)] public double? OuterMm { get; set; }
        /// <summary>
        /// Width of a ridge. It lies between two detents: friction brakes there, and lets go when
        /// the finger has passed. It never pulls the finger anywhere, as a spring would.
        /// </summary>
        [Preserve, JsonProperty("ridge_mm", NullValueHandling = NullValueHandling.Ignore)] public double? RidgeMm { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
    }

    /// <summary>Another material times a curve in time.</summary>
    [Preserve] public partial class Envelope
    {
        /// <summary>From when its time counts.</summary>
        [Preserve, JsonProperty("begins", NullValueHandling = NullValueHandling.Ignore)] public string Begins { get; set; }
        /// <summary>Factors against time; before and after, those of its ends.</summary>
        [Preserve, JsonProperty("curve")] public object Curve { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Whether it begins again at its end.</summary>
        [Preserve, JsonProperty("loop", NullValueHandling = NullValueHandling.Ignore)] public bool? Loop { get; set; }
        /// <summary>Material that the curve multiplies.</summary>
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>The first `length_s` of a signal; 0 where it has ended before.</summary>
    [Preserve] public partial class Excerpt
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("length_s")] public double LengthS { get; set; }
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>A periodic wave of friction without end.</summary>
    [Preserve] public partial class Grating
    {
        /// <summary>Part of the period for which the square wave is high.</summary>
        [Preserve, JsonProperty("duty", NullValueHandling = NullValueHandling.Ignore)] public double? Duty { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>Direction in which it runs: 0 to the right, 90 down. Its ridges lie across.</summary>
        [Preserve, JsonProperty("orientation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? OrientationDeg { get; set; }
        /// <summary>Distance from one rib to the next.</summary>
        [Preserve, JsonProperty("period_mm")] public double PeriodMm { get; set; }
        /// <summary>Part of the period that lies before the origin. The sine is at its middle and rises there.</summary>
        [Preserve, JsonProperty("phase", NullValueHandling = NullValueHandling.Ignore)] public double? Phase { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Shape of the ribs. The square wave is high first. The sawtooth rises and falls at once.</summary>
        [Preserve, JsonProperty("wave", NullValueHandling = NullValueHandling.Ignore)] public string Wave { get; set; }
    }

    /// <summary>A height map, felt by one rule; `relief` is right in every direction.</summary>
    [Preserve] public partial class Heights
    {
        /// <summary>Direction of the stroke for "slope-along": 0 to the right, 90 down.</summary>
        [Preserve, JsonProperty("direction_deg", NullValueHandling = NullValueHandling.Ignore)] public double? DirectionDeg { get; set; }
        /// <summary>Picture of the heights, bright is high.</summary>
        [Preserve, JsonProperty("file")] public string File { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>What makes friction.</summary>
        [Preserve, JsonProperty("rule", NullValueHandling = NullValueHandling.Ignore)] public string Rule { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Width on the screen; the height follows from the pixels.</summary>
        [Preserve, JsonProperty("width_mm")] public double WidthMm { get; set; }
    }

    /// <summary>Materials of every kind in regions; see `haptix.Layout`, which its evaluator is.</summary>
    [Preserve] public partial class LayoutMaterial
    {
        /// <summary>Friction below all regions.</summary>
        [Preserve, JsonProperty("background")] public object Background { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Each a `haptix.feel.Region`; with a ``name`` it is found by `region`.</summary>
        [Preserve, JsonProperty("regions", NullValueHandling = NullValueHandling.Ignore)] public Region[] Regions { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Quantity of the answers.</summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
    }

    /// <summary>
    /// A material in a region of a layout.
    ///
    /// Parameters
    /// ----------
    /// name : str, optional
    /// By which `LayoutMaterial.region` finds it.
    /// material : FrictionField or Material
    /// Material; its origin lies at the region's corner.
    /// mask : FrictionField or Material, optional
    /// Opacity at every place of the region, as a share.
    ///
    /// Raises
    /// ------
    /// InputError
    /// If a value is outside its range.
    /// </summary>
    [Preserve] public partial class Region
    {
        [Preserve, JsonProperty("blend")] public string Blend { get; set; }
        [Preserve, JsonProperty("group")] public string Group { get; set; }
        [Preserve, JsonProperty("height_mm")] public double? HeightMm { get; set; }
        [Preserve, JsonProperty("mask")] public object Mask { get; set; }
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

    /// <summary>A material's target under the finger, along x at a height `y_mm`, with all detail.</summary>
    [Preserve] public partial class MaterialSignal
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length.</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        /// <summary>Normal force [N]; in a stimulus, that of the stimulus.</summary>
        [Preserve, JsonProperty("normal_force_n", NullValueHandling = NullValueHandling.Ignore)] public double? NormalForceN { get; set; }
        /// <summary>Or its table, or the path of its file.</summary>
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>How the finger moves; a number is a steady speed [mm/s].</summary>
        [Preserve, JsonProperty("speed")] public object Speed { get; set; }
        /// <summary>Where.</summary>
        [Preserve, JsonProperty("y_mm", NullValueHandling = NullValueHandling.Ignore)] public double? YMm { get; set; }
    }

    /// <summary>A mixture of two finite signals of one length.</summary>
    [Preserve] public partial class Morph
    {
        /// <summary>At shares of 0 and 1.</summary>
        [Preserve, JsonProperty("end")] public object End { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>0 to 1.</summary>
        [Preserve, JsonProperty("share")] public double Share { get; set; }
        /// <summary>At shares of 0 and 1.</summary>
        [Preserve, JsonProperty("start")] public object Start { get; set; }
    }

    /// <summary>Another material that moves over the screen; time counts from the first sample.</summary>
    [Preserve] public partial class Moving
    {
        /// <summary>The place in the material about which it turns.</summary>
        [Preserve, JsonProperty("about_mm", NullValueHandling = NullValueHandling.Ignore)] public double[] AboutMm { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>What moves.</summary>
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        /// <summary>Places against time, added to the velocity's.</summary>
        [Preserve, JsonProperty("path")] public PathTable Path { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>How fast it turns, from x towards y, about `about_mm`.</summary>
        [Preserve, JsonProperty("turn_deg_s", NullValueHandling = NullValueHandling.Ignore)] public double? TurnDegS { get; set; }
        /// <summary>Velocity along x and y.</summary>
        [Preserve, JsonProperty("velocity_mm_s", NullValueHandling = NullValueHandling.Ignore)] public double[] VelocityMmS { get; set; }
    }

    /// <summary>
    /// Places against time, straight lines between them; beyond its ends it stays, or begins
    /// again.
    ///
    /// Parameters
    /// ----------
    /// t_s : list of float
    /// Times [s], increasing from 0.
    /// x_mm, y_mm : list of float
    /// How far the material has moved.
    /// angle_deg : list of float, optional
    /// How far it has turned, from x towards y.
    /// loop : bool
    /// Whether the path begins again at its end.
    ///
    /// Examples
    /// --------
    /// >>> PathTable(t_s=[0.0, 1.0], x_mm=[0.0, 50.0], y_mm=[0.0, 0.0]).loop
    /// False
    /// </summary>
    [Preserve] public partial class PathTable
    {
        [Preserve, JsonProperty("angle_deg")] public double[] AngleDeg { get; set; }
        [Preserve, JsonProperty("loop", NullValueHandling = NullValueHandling.Ignore)] public bool? Loop { get; set; }
        [Preserve, JsonProperty("t_s")] public double[] TS { get; set; }
        [Preserve, JsonProperty("x_mm")] public double[] XMm { get; set; }
        [Preserve, JsonProperty("y_mm")] public double[] YMm { get; set; }
    }

    /// <summary>Gaussian noise on a tile that repeats without a seam.</summary>
    [Preserve] public partial class Noise
    {
        /// <summary>Mean of the friction, and how far it strays from it.</summary>
        [Preserve, JsonProperty("deviation", NullValueHandling = NullValueHandling.Ignore)] public double? Deviation { get; set; }
        /// <summary>The power falls with the wavenumber to this power: 0 is white.</summary>
        [Preserve, JsonProperty("exponent", NullValueHandling = NullValueHandling.Ignore)] public double? Exponent { get; set; }
        /// <summary>Noise over the plane, or along one direction.</summary>
        [Preserve, JsonProperty("grain", NullValueHandling = NullValueHandling.Ignore)] public string Grain { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Sizes of the smallest and of the largest unevenness: there is power between them.</summary>
        [Preserve, JsonProperty("longest_mm", NullValueHandling = NullValueHandling.Ignore)] public double? LongestMm { get; set; }
        /// <summary>Mean of the friction, and how far it strays from it.</summary>
        [Preserve, JsonProperty("mean", NullValueHandling = NullValueHandling.Ignore)] public double? Mean { get; set; }
        /// <summary>Direction of the ribbed grain: 0 to the right, 90 down.</summary>
        [Preserve, JsonProperty("orientation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? OrientationDeg { get; set; }
        /// <summary>Pixels along it, a power of two.</summary>
        [Preserve, JsonProperty("pixels", NullValueHandling = NullValueHandling.Ignore)] public long? Pixels { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Same seed, same noise.</summary>
        [Preserve, JsonProperty("seed", NullValueHandling = NullValueHandling.Ignore)] public long? Seed { get; set; }
        /// <summary>Sizes of the smallest and of the largest unevenness: there is power between them.</summary>
        [Preserve, JsonProperty("shortest_mm", NullValueHandling = NullValueHandling.Ignore)] public double? ShortestMm { get; set; }
        /// <summary>
        /// Quantity of these: shares of the reach of the screen, friction coefficients, or relative
        /// changes of friction.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Side of the tile.</summary>
        [Preserve, JsonProperty("tile_mm", NullValueHandling = NullValueHandling.Ignore)] public double? TileMm { get; set; }
    }

    /// <summary>A model of the Penn Haptic Texture Toolkit at one speed and force.</summary>
    [Preserve] public partial class Penn
    {
        /// <summary>XML of the model.</summary>
        [Preserve, JsonProperty("file")] public string File { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Turns accelerations into forces; an assumption.</summary>
        [Preserve, JsonProperty("mass_kg", NullValueHandling = NullValueHandling.Ignore)] public double? MassKg { get; set; }
        /// <summary>Where the pattern has the model's spectrum.</summary>
        [Preserve, JsonProperty("normal_force_n", NullValueHandling = NullValueHandling.Ignore)] public double? NormalForceN { get; set; }
        /// <summary>Direction of the stroke.</summary>
        [Preserve, JsonProperty("orientation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? OrientationDeg { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Same seed, same pattern.</summary>
        [Preserve, JsonProperty("seed", NullValueHandling = NullValueHandling.Ignore)] public long? Seed { get; set; }
        /// <summary>Where the pattern has the model's spectrum.</summary>
        [Preserve, JsonProperty("speed_mm_per_s", NullValueHandling = NullValueHandling.Ignore)] public double? SpeedMmPerS { get; set; }
    }

    /// <summary>A photograph, whose grey from the 1st to the 99th percentile becomes friction.</summary>
    [Preserve] public partial class Photograph
    {
        /// <summary>The photograph: PNG, JPEG or TIFF.</summary>
        [Preserve, JsonProperty("file")] public string File { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>Which end of the grey scale has the higher friction.</summary>
        [Preserve, JsonProperty("polarity", NullValueHandling = NullValueHandling.Ignore)] public string Polarity { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Width on the screen; the height follows from the pixels.</summary>
        [Preserve, JsonProperty("width_mm")] public double WidthMm { get; set; }
    }

    /// <summary>Straight lines between corners; the last corner is the end.</summary>
    [Preserve] public partial class Points
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Times of the corners [s], increasing.</summary>
        [Preserve, JsonProperty("t_s")] public double[] TS { get; set; }
        /// <summary>Values at them.</summary>
        [Preserve, JsonProperty("values_at")] public double[] ValuesAt { get; set; }
    }

    /// <summary>Signals multiplied; as long as the shortest.</summary>
    [Preserve] public partial class Product
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("parts")] public object[] Parts { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>`height` for `width_s` from `at_s` on, `rest` before and after.</summary>
    [Preserve] public partial class Pulse
    {
        /// <summary>When it begins [s].</summary>
        [Preserve, JsonProperty("at_s", NullValueHandling = NullValueHandling.Ignore)] public double? AtS { get; set; }
        /// <summary>Value within the pulse, and outside.</summary>
        [Preserve, JsonProperty("height")] public double Height { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length of the signal [s]; endless if not given.</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        /// <summary>Value within the pulse, and outside.</summary>
        [Preserve, JsonProperty("rest", NullValueHandling = NullValueHandling.Ignore)] public double? Rest { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Its width [s].</summary>
        [Preserve, JsonProperty("width_s")] public double WidthS { get; set; }
    }

    /// <summary>A straight line from `start` at 0 to `end` at the length.</summary>
    [Preserve] public partial class Ramp
    {
        /// <summary>First and last value.</summary>
        [Preserve, JsonProperty("end")] public double End { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("length_s")] public double LengthS { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>First and last value.</summary>
        [Preserve, JsonProperty("start")] public double Start { get; set; }
    }

    /// <summary>A recorded signal, once; resampled where rates differ.</summary>
    [Preserve] public partial class Recorded
    {
        /// <summary>WAV or FLAC file of one channel.</summary>
        [Preserve, JsonProperty("file")] public string File { get; set; }
        /// <summary>``offset + gain * sample``, samples being within -1 and 1.</summary>
        [Preserve, JsonProperty("gain", NullValueHandling = NullValueHandling.Ignore)] public double? Gain { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>``offset + gain * sample``, samples being within -1 and 1.</summary>
        [Preserve, JsonProperty("offset", NullValueHandling = NullValueHandling.Ignore)] public double? Offset { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        [Preserve, JsonProperty("sha256", NullValueHandling = NullValueHandling.Ignore)] public string Sha256 { get; set; }
    }

    /// <summary>Friction recorded along a line, the same across it.</summary>
    [Preserve] public partial class Recording
    {
        /// <summary>Friction beyond the ends: the lowest, or that of the end.</summary>
        [Preserve, JsonProperty("beyond", NullValueHandling = NullValueHandling.Ignore)] public string Beyond { get; set; }
        /// <summary>CSV with position_mm and mu, or with position_mm and forces; or HJIF of friction.</summary>
        [Preserve, JsonProperty("file")] public string File { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>The normal force of the recording, where it is no column.</summary>
        [Preserve, JsonProperty("normal_force_n")] public double? NormalForceN { get; set; }
        /// <summary>Direction of the line: 0 to the right, 90 down.</summary>
        [Preserve, JsonProperty("orientation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? OrientationDeg { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Step of the even grid on which it is kept.</summary>
        [Preserve, JsonProperty("step_mm")] public double? StepMm { get; set; }
    }

    /// <summary>Bumps and edges that resist uphill and give way downhill, whichever way one strokes.</summary>
    [Preserve] public partial class Relief
    {
        /// <summary>Level on the flat; 0 where the relief is added to another material.</summary>
        [Preserve, JsonProperty("bias", NullValueHandling = NullValueHandling.Ignore)] public double? Bias { get; set; }
        /// <summary>Within this from the edges the bias rises from 0.</summary>
        [Preserve, JsonProperty("edge_mm", NullValueHandling = NullValueHandling.Ignore)] public double? EdgeMm { get; set; }
        /// <summary>Picture of the heights, bright is high.</summary>
        [Preserve, JsonProperty("heights")] public string Heights { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>Picture of the surface's normals instead: red to the right, green up, as games have them.</summary>
        [Preserve, JsonProperty("normals")] public string Normals { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Width on the screen.</summary>
        [Preserve, JsonProperty("width_mm")] public double WidthMm { get; set; }
    }

    /// <summary>A finite signal repeated; `times` may be infinite.</summary>
    [Preserve] public partial class Repetition
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>How often; endless if not given.</summary>
        [Preserve, JsonProperty("times")] public object Times { get; set; }
    }

    /// <summary>``offset + amplitude * sin(2 pi f t + phase)``.</summary>
    [Preserve] public partial class Sine
    {
        /// <summary>Amplitude, and the value about which it swings.</summary>
        [Preserve, JsonProperty("amplitude")] public double Amplitude { get; set; }
        [Preserve, JsonProperty("frequency_hz")] public double FrequencyHz { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length [s]; endless if not given.</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        /// <summary>Amplitude, and the value about which it swings.</summary>
        [Preserve, JsonProperty("offset", NullValueHandling = NullValueHandling.Ignore)] public double? Offset { get; set; }
        /// <summary>Phase at the start [rad].</summary>
        [Preserve, JsonProperty("phase_rad", NullValueHandling = NullValueHandling.Ignore)] public double? PhaseRad { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>A slider along x from the origin: ridges between its detents, walls at its ends.</summary>
    [Preserve] public partial class Slider
    {
        /// <summary>How many, evenly spaced; or their places [mm], increasing.</summary>
        [Preserve, JsonProperty("detents")] public object Detents { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>Direction of the travel: 0 to the right, 90 down.</summary>
        [Preserve, JsonProperty("orientation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? OrientationDeg { get; set; }
        /// <summary>
        /// Width of a ridge. It lies between two detents: friction brakes there, and lets go when
        /// the finger has passed. It never pulls the finger anywhere, as a spring would.
        /// </summary>
        [Preserve, JsonProperty("ridge_mm", NullValueHandling = NullValueHandling.Ignore)] public double? RidgeMm { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Whether `value` is that of the nearest detent. The screen does not move the finger there.</summary>
        [Preserve, JsonProperty("snap", NullValueHandling = NullValueHandling.Ignore)] public bool? Snap { get; set; }
        /// <summary>
        /// Place of the first detent; places of `detents` count from it. A region needs room before
        /// it for the wall.
        /// </summary>
        [Preserve, JsonProperty("start_mm", NullValueHandling = NullValueHandling.Ignore)] public double? StartMm { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>From the first detent to the last.</summary>
        [Preserve, JsonProperty("travel_mm", NullValueHandling = NullValueHandling.Ignore)] public double? TravelMm { get; set; }
    }

    /// <summary>Random friction whose spectrum is given by 13 levels and some waves, as from a recording.</summary>
    [Preserve] public partial class Spectral
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>
        /// Levels of the changes [dB], of the whole band around each of 13 wavenumbers, even in
        /// their logarithm from 0.1 to 46.4 waves per millimetre.
        /// </summary>
        [Preserve, JsonProperty("level_db", NullValueHandling = NullValueHandling.Ignore)] public double[] LevelDb { get; set; }
        /// <summary>Mean, above the friction without voltage.</summary>
        [Preserve, JsonProperty("mean", NullValueHandling = NullValueHandling.Ignore)] public double? Mean { get; set; }
        /// <summary>Direction of the stroke: 0 to the right, 90 down.</summary>
        [Preserve, JsonProperty("orientation_deg", NullValueHandling = NullValueHandling.Ignore)] public double? OrientationDeg { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Same seed, same pattern.</summary>
        [Preserve, JsonProperty("seed", NullValueHandling = NullValueHandling.Ignore)] public long? Seed { get; set; }
        /// <summary>What mean and changes are: relative changes of friction, or friction coefficients.</summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Length after which it repeats.</summary>
        [Preserve, JsonProperty("tile_mm", NullValueHandling = NullValueHandling.Ignore)] public double? TileMm { get; set; }
        /// <summary>Waves that stand out: period and amplitude of each.</summary>
        [Preserve, JsonProperty("waves", NullValueHandling = NullValueHandling.Ignore)] public double[][] Waves { get; set; }
    }

    /// <summary>``offset + amplitude`` for the first `duty` of a period, ``offset - amplitude`` then.</summary>
    [Preserve] public partial class Square
    {
        /// <summary>Amplitude, and the value about which it swings.</summary>
        [Preserve, JsonProperty("amplitude")] public double Amplitude { get; set; }
        /// <summary>Share of a period with the higher value, between 0 and 1.</summary>
        [Preserve, JsonProperty("duty", NullValueHandling = NullValueHandling.Ignore)] public double? Duty { get; set; }
        [Preserve, JsonProperty("frequency_hz")] public double FrequencyHz { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length [s]; endless if not given.</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        /// <summary>Amplitude, and the value about which it swings.</summary>
        [Preserve, JsonProperty("offset", NullValueHandling = NullValueHandling.Ignore)] public double? Offset { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>`before` until `at_s`, `after` from there on.</summary>
    [Preserve] public partial class Step
    {
        /// <summary>Value before the step, and from it on.</summary>
        [Preserve, JsonProperty("after")] public double After { get; set; }
        /// <summary>When it steps [s].</summary>
        [Preserve, JsonProperty("at_s")] public double AtS { get; set; }
        /// <summary>Value before the step, and from it on.</summary>
        [Preserve, JsonProperty("before")] public double Before { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length of the signal [s]; endless if not given.</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>Signals added; as long as the longest. A signal that has ended adds 0.</summary>
    [Preserve] public partial class Sum
    {
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("parts")] public object[] Parts { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>Gaussian noise of a given deviation and shape of spectrum.</summary>
    [Preserve] public partial class TimeNoise
    {
        /// <summary>Relative power per hertz at the corners, linear in between; by default a flat band.</summary>
        [Preserve, JsonProperty("density", NullValueHandling = NullValueHandling.Ignore)] public double[] Density { get; set; }
        /// <summary>Standard deviation.</summary>
        [Preserve, JsonProperty("deviation")] public double Deviation { get; set; }
        /// <summary>
        /// Power falls as ``1/f`` to this: 1 is pink, 2 brown noise; within the corners, which begin
        /// above 0 Hz then.
        /// </summary>
        [Preserve, JsonProperty("exponent", NullValueHandling = NullValueHandling.Ignore)] public double? Exponent { get; set; }
        /// <summary>Corners of the spectrum [Hz], increasing; no power outside.</summary>
        [Preserve, JsonProperty("frequency_hz")] public double[] FrequencyHz { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Length [s].</summary>
        [Preserve, JsonProperty("length_s")] public object LengthS { get; set; }
        /// <summary>Mean value.</summary>
        [Preserve, JsonProperty("mean", NullValueHandling = NullValueHandling.Ignore)] public double? Mean { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>Same seed, same noise.</summary>
        [Preserve, JsonProperty("seed")] public long Seed { get; set; }
    }

    /// <summary>A switch with two sides along x, its corner at the origin.</summary>
    [Preserve] public partial class Toggle
    {
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("high", NullValueHandling = NullValueHandling.Ignore)] public double? High { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Friction at the lowest and at the highest level.</summary>
        [Preserve, JsonProperty("low", NullValueHandling = NullValueHandling.Ignore)] public double? Low { get; set; }
        /// <summary>
        /// Width of a ridge. It lies between two detents: friction brakes there, and lets go when
        /// the finger has passed. It never pulls the finger anywhere, as a spring would.
        /// </summary>
        [Preserve, JsonProperty("ridge_mm", NullValueHandling = NullValueHandling.Ignore)] public double? RidgeMm { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>
        /// Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients,
        /// or relative changes of friction; see `haptix.feel.as_mu`.
        /// </summary>
        [Preserve, JsonProperty("target", NullValueHandling = NullValueHandling.Ignore)] public string Target { get; set; }
        /// <summary>Way over which friction rises.</summary>
        [Preserve, JsonProperty("throw_mm", NullValueHandling = NullValueHandling.Ignore)] public double? ThrowMm { get; set; }
        /// <summary>Width; the middle is at half of it. What is left at its default is that of the region.</summary>
        [Preserve, JsonProperty("width_mm", NullValueHandling = NullValueHandling.Ignore)] public double? WidthMm { get; set; }
    }

    /// <summary>A curve that begins at an event: a pulse, a sweep, a chain of points, an audio clip.</summary>
    [Preserve] public partial class Transient
    {
        /// <summary>The event with which it begins.</summary>
        [Preserve, JsonProperty("begins", NullValueHandling = NullValueHandling.Ignore)] public string Begins { get; set; }
        /// <summary>Shares of the reachable range against time.</summary>
        [Preserve, JsonProperty("curve")] public object Curve { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>One of the web's effects, with an intensity.</summary>
    [Preserve] public partial class WebEffect
    {
        /// <summary>The event with which it begins.</summary>
        [Preserve, JsonProperty("begins", NullValueHandling = NullValueHandling.Ignore)] public string Begins { get; set; }
        /// <summary>How strong, 0 to 1.</summary>
        [Preserve, JsonProperty("intensity", NullValueHandling = NullValueHandling.Ignore)] public double? Intensity { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        /// <summary>Which one.</summary>
        [Preserve, JsonProperty("name")] public string Name { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
    }

    /// <summary>A finite signal faded in from `rest` and out to it.</summary>
    [Preserve] public partial class Window
    {
        /// <summary>Times of the fades in and out [s].</summary>
        [Preserve, JsonProperty("fall_s")] public double FallS { get; set; }
        [Preserve, JsonProperty("kind")] public string Kind { get; set; }
        [Preserve, JsonProperty("of")] public object Of { get; set; }
        /// <summary>Value before and after.</summary>
        [Preserve, JsonProperty("rest", NullValueHandling = NullValueHandling.Ignore)] public double? Rest { get; set; }
        /// <summary>Times of the fades in and out [s].</summary>
        [Preserve, JsonProperty("rise_s")] public double RiseS { get; set; }
        [Preserve, JsonProperty("schema_version", NullValueHandling = NullValueHandling.Ignore)] public long? SchemaVersion { get; set; }
        /// <summary>"raised-cosine" or "linear".</summary>
        [Preserve, JsonProperty("shape", NullValueHandling = NullValueHandling.Ignore)] public string Shape { get; set; }
    }
}
namespace Haptix.Materials
{
    public partial class Button : Haptix.Material { public Button() { Kind = "button"; } }
    public partial class ByForce : Haptix.Material { public ByForce() { Kind = "by-force"; } }
    public partial class BySpeed : Haptix.Material { public BySpeed() { Kind = "by-speed"; } }
    public partial class Dial : Haptix.Material { public Dial() { Kind = "dial"; } }
    public partial class WebEffect : Haptix.Material { public WebEffect() { Kind = "effect"; } }
    public partial class Envelope : Haptix.Material { public Envelope() { Kind = "envelope"; } }
    public partial class Grating : Haptix.Material { public Grating() { Kind = "grating"; } }
    public partial class Heights : Haptix.Material { public Heights() { Kind = "heights"; } }
    public partial class LayoutMaterial : Haptix.Material { public LayoutMaterial() { Kind = "layout"; } }
    public partial class Moving : Haptix.Material { public Moving() { Kind = "moving"; } }
    public partial class Noise : Haptix.Material { public Noise() { Kind = "noise"; } }
    public partial class Penn : Haptix.Material { public Penn() { Kind = "penn"; } }
    public partial class Photograph : Haptix.Material { public Photograph() { Kind = "photograph"; } }
    public partial class Recording : Haptix.Material { public Recording() { Kind = "recording"; } }
    public partial class Relief : Haptix.Material { public Relief() { Kind = "relief"; } }
    public partial class Slider : Haptix.Material { public Slider() { Kind = "slider"; } }
    public partial class Spectral : Haptix.Material { public Spectral() { Kind = "spectral"; } }
    public partial class Toggle : Haptix.Material { public Toggle() { Kind = "toggle"; } }
    public partial class Transient : Haptix.Material { public Transient() { Kind = "transient"; } }
}
