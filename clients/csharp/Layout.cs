// What is felt where: regions of materials, for code that writes no JSON.
namespace Haptix
{
    using System;
    using System.Collections.Generic;
    using System.IO;
    using System.Net;
    using System.Security.Cryptography;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json.Linq;

    /// <summary>A material's document, such as `haptix material` and the studio save.</summary>
    public sealed class Material
    {
        public readonly JObject Document;

        Material(JObject document) { Document = document; }

        /// <summary>Return the material of a JSON text, such as `{"kind": "grating", "period_mm": 2}`.</summary>
        public static Material Parse(string json) { return new Material(JObject.Parse(json)); }

        /// <summary>Return the material of a file. Files that it names are sent by `Session.Asset`.</summary>
        public static Material Load(string path) { return Parse(File.ReadAllText(path)); }
    }

    /// <summary>The layout of a session; `Session.Layout`.</summary>
    public sealed class Layout
    {
        readonly Session _session;
        int _count;

        internal Layout(Session session) { _session = session; }

        /// <summary>
        /// Add a region and return it. Millimetres from the screen's corner; without a size it is as
        /// large as its material. The name is for `Contact.Region`, and made where none is given.
        /// </summary>
        public async Task<Region> Add(Material material, double xMm = 0, double yMm = 0, double? widthMm = null,
            double? heightMm = null, double? rotationDeg = null, string shape = null, string blend = null,
            double? opacity = null, string name = null)
        {
            var region = new Region(_session, name ?? "region " + ++_count);
            await region.Send("add", new JObject {
                { "material", material.Document }, { "x_mm", xMm }, { "y_mm", yMm }, { "width_mm", widthMm },
                { "height_mm", heightMm }, { "rotation_deg", rotationDeg }, { "shape", shape }, { "blend", blend },
                { "opacity", opacity } }).ConfigureAwait(false);
            return region;
        }

        /// <summary>Remove all regions.</summary>
        public Task<LayoutReply> Clear() { return _session.LayoutSet("{\"regions\": []}"); }
    }

    /// <summary>A region of the layout, by its name.</summary>
    public sealed class Region
    {
        readonly Session _session;
        public readonly string Name;

        internal Region(Session session, string name)
        {
            _session = session;
            Name = name;
        }

        /// <summary>Move it there within a time; what is not given stays.</summary>
        public Task<LayoutReply> Move(double? xMm = null, double? yMm = null, double? rotationDeg = null, double overS = 0.02)
        {
            return Send("move", new JObject {
                { "x_mm", xMm }, { "y_mm", yMm }, { "rotation_deg", rotationDeg }, { "over_s", overS } });
        }

        /// <summary>Change what is given, in a cross-fade.</summary>
        public Task<LayoutReply> Change(Material material = null, double? widthMm = null, double? heightMm = null,
            double? opacity = null)
        {
            return Send("change", new JObject {
                { "material", material == null ? null : material.Document }, { "width_mm", widthMm },
                { "height_mm", heightMm }, { "opacity", opacity } });
        }

        /// <summary>Set the value of a control, such as a slider, 0 to 1.</summary>
        public Task<LayoutReply> SetValue(double value) { return Send("value", new JObject { { "value", value } }); }

        /// <summary>Remove it; it fades out.</summary>
        public Task<LayoutReply> Remove() { return Send("remove", new JObject()); }

        internal Task<LayoutReply> Send(string op, JObject fields)
        {
            var change = new JObject { { "op", op }, { "name", Name } };
            foreach (KeyValuePair<string, JToken> field in fields)
                if (field.Value != null && field.Value.Type != JTokenType.Null) change[field.Key] = field.Value;
            return _session.LayoutChange(new JArray { change }.ToString());
        }
    }

    public sealed partial class Session
    {
        Layout _layout;

        /// <summary>What is felt where. The service keeps it for who connects again.</summary>
        public Layout Layout { get { return _layout ?? (_layout = new Layout(this)); } }

        /// <summary>Send a file that materials read, once; return `sha256:...`, by which a document calls it.</summary>
        public Task<string> Asset(string path)
        {
            return Task.Run(() =>
            {
                byte[] content = File.ReadAllBytes(path);
                string suffix = Path.GetExtension(path).ToLowerInvariant(), digest;
                using (SHA256 sha = SHA256.Create())
                    digest = BitConverter.ToString(sha.ComputeHash(content)).Replace("-", "").ToLowerInvariant();
                Service service = _find();
                var address = new Uri(new Uri("http" + service.Url.Substring(2)), "/v1/assets/" + digest + "?suffix=" + suffix);
                var request = (HttpWebRequest)WebRequest.Create(address);
                request.Method = "PUT";
                request.Headers["Authorization"] = "Bearer " + service.Token;
                try
                {
                    using (Stream body = request.GetRequestStream()) body.Write(content, 0, content.Length);
                    request.GetResponse().Close();
                }
                catch (WebException error)
                {
                    if (error.Response == null) throw new Lost("asset: " + error.Message);
                    using (var reader = new StreamReader(error.Response.GetResponseStream()))
                        throw new Refused(JObject.Parse(reader.ReadToEnd()).ToObject<Error>());
                }
                return "sha256:" + digest;
            });
        }
    }
}
