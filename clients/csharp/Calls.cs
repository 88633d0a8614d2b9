// The requests of a session. Made by scripts/client_calls.py from the description of the session; do not edit.
namespace Haptix
{
    using System.Collections.Generic;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json.Linq;

    public sealed partial class Session
    {
        /// <summary>Ask for the lease on the output; with `takeover` also from who holds it.</summary>
        public Task<Lease> Acquire(bool takeover = false)
        {
            return Ask<Lease>("acquire", new JObject { { "takeover", takeover } });
        }

        /// <summary>Let touches be felt.</summary>
        public Task<Output> Arm()
        {
            return Ask<Output>("arm", new JObject());
        }

        /// <summary>End an effect by the number that `playing` gave.</summary>
        public Task<Done> Cancel(long effectId)
        {
            return Ask<Done>("cancel", new JObject { { "effect_id", effectId } });
        }

        /// <summary>Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.</summary>
        public Task<Done> Geometry(double pxPerMm, double[] originMm = null, double rotationDeg = 0.0)
        {
            return Ask<Done>("geometry", new JObject { { "px_per_mm", pxPerMm }, { "origin_mm", Json(originMm) },
                { "rotation_deg", rotationDeg } });
        }

        /// <summary>Set the share of friction that is asked for, 0 to 1.</summary>
        public Task<Output> Intensity(double value)
        {
            return Ask<Output>("intensity", new JObject { { "value", value } });
        }

        /// <summary>Ask which devices and profiles there are.</summary>
        public Task<Inventory> Inventory()
        {
            return Ask<Inventory>("inventory", new JObject());
        }

        /// <summary>Change the layout of this session: all of `ops`, or nothing.</summary>
        public Task<LayoutReply> LayoutChange(IList<object> ops)
        {
            return Ask<LayoutReply>("layout_change", new JObject { { "ops", Json(ops) } });
        }

        /// <summary>Replace the layout of this session by a document.</summary>
        public Task<LayoutReply> LayoutSet(LayoutDocument document)
        {
            return Ask<LayoutReply>("layout_set", new JObject { { "document", Json(document) } });
        }

        /// <summary>Hold 0 V while time runs, until the lease ends.</summary>
        public Task<Output> Mute(bool on = true)
        {
            return Ask<Output>("mute", new JObject { { "on", on } });
        }

        /// <summary>Hold 0 V while time stands, until the lease ends.</summary>
        public Task<Output> Pause(bool on = true)
        {
            return Ask<Output>("pause", new JObject { { "on", on } });
        }

        /// <summary>Play an effect that ends, such as a transient; `effect_ended` reports its end.</summary>
        public Task<Playing> Play(Material effect)
        {
            return Ask<Playing>("play", new JObject { { "effect", Json(effect) } });
        }

        /// <summary>Give the lease back; 0 V first.</summary>
        public Task<Done> Release()
        {
            return Ask<Done>("release", new JObject());
        }

        /// <summary>Learn the finger by the current that it draws, from the next `arm` on.</summary>
        public Task<Output> Sense(bool on = true)
        {
            return Ask<Output>("sense", new JObject { { "on", on } });
        }

        /// <summary>End at 0 V, whoever holds the output; the holder keeps the lease.</summary>
        public Task<Done> Stop()
        {
            return Ask<Done>("stop", new JObject());
        }

        /// <summary>Ask for streams, each with its highest rate in hertz; 0 ends one.</summary>
        public Task<Subscribed> Subscribe(IDictionary<string, double> streams)
        {
            return Ask<Subscribed>("subscribe", new JObject { { "streams", Json(streams) } });
        }

        /// <summary>Request the progress of a job, and its changes until it ends.</summary>
        public Task<Job> Watch(string job)
        {
            return Ask<Job>("watch", new JObject { { "job", job } });
        }
    }

    public sealed partial class Layout
    {
        /// <summary>Add a region.</summary>
        public async Task<Region> Add(Material material, double? xMm = null, double? yMm = null,
            double? rotationDeg = null, double? widthMm = null, double? heightMm = null, object shape = null,
            double? scale = null, double? z = null, string blend = null, double? opacity = null,
            long? priority = null, string group = null, string name = "")
        {
            var region = new Region(_session, name != "" ? name : "region " + ++_count);
            await region.Send("add", new JObject { { "material", Json(material) }, { "x_mm", xMm }, { "y_mm", yMm },
                { "rotation_deg", rotationDeg }, { "width_mm", widthMm }, { "height_mm", heightMm },
                { "shape", Json(shape) }, { "scale", scale }, { "z", z }, { "blend", blend },
                { "opacity", opacity }, { "priority", priority }, { "group", group } }).ConfigureAwait(false);
            return region;
        }
    }

    public sealed partial class Region
    {
        /// <summary>Change the given fields of a region, in a cross-fade.</summary>
        public Task<LayoutReply> Change(double? xMm = null, double? yMm = null, double? rotationDeg = null,
            double? widthMm = null, double? heightMm = null, object shape = null, double? scale = null,
            double? z = null, string blend = null, double? opacity = null, long? priority = null,
            string group = null, Material material = null)
        {
            return Send("change", new JObject { { "x_mm", xMm }, { "y_mm", yMm }, { "rotation_deg", rotationDeg },
                { "width_mm", widthMm }, { "height_mm", heightMm }, { "shape", Json(shape) }, { "scale", scale },
                { "z", z }, { "blend", blend }, { "opacity", opacity }, { "priority", priority },
                { "group", group }, { "material", Json(material) } });
        }

        /// <summary>Move a region within `over_s`; fields that are left out stay.</summary>
        public Task<LayoutReply> Move(double? xMm = null, double? yMm = null, double? rotationDeg = null,
            double overS = 0.02)
        {
            return Send("move", new JObject { { "x_mm", xMm }, { "y_mm", yMm }, { "rotation_deg", rotationDeg },
                { "over_s", overS } });
        }

        /// <summary>Remove a region; it fades out.</summary>
        public Task<LayoutReply> Remove()
        {
            return Send("remove", new JObject());
        }

        /// <summary>Set the value of a control, such as a slider; it comes after all other changes.</summary>
        public Task<LayoutReply> SetValue(double value)
        {
            return Send("value", new JObject { { "value", value } });
        }
    }
}
