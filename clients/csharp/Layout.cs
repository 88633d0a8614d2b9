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
    using Newtonsoft.Json;
    using Newtonsoft.Json.Linq;

    /// <summary>A material: an object of `Haptix.Materials`, or a document, such as `haptix material` saves.</summary>
    public abstract class Material
    {
        sealed class Saved : Material
        {
            [Preserve, JsonExtensionData]
            public IDictionary<string, JToken> Fields;
        }

        /// <summary>Return the material of a JSON text, such as `{"kind": "grating", "period_mm": 2}`.</summary>
        public static Material Parse(string json) { return new Saved { Fields = JObject.Parse(json) }; }

        /// <summary>Return the material of a file. Files that it names are sent by `Session.Asset`.</summary>
        public static Material Load(string path) { return Parse(File.ReadAllText(path)); }
    }

    /// <summary>The layout of a session; `Session.Layout`. Millimetres from the screen's corner.</summary>
    public sealed partial class Layout
    {
        readonly Session _session;
        int _count;

        internal Layout(Session session) { _session = session; }

        /// <summary>Return a region that is there, by its name.</summary>
        public Region Of(string name) { return new Region(_session, name); }

        /// <summary>Remove all regions.</summary>
        public Task<LayoutReply> Clear() { return _session.LayoutSet(new LayoutDocument { Regions = new RegionDocument[0] }); }

        static JToken Json(object value) { return Session.Json(value); }
    }

    /// <summary>A region of the layout, by its name; each call is one change.</summary>
    public sealed partial class Region
    {
        public readonly Session Session;
        public readonly string Name;

        internal Region(Session session, string name)
        {
            Session = session;
            Name = name;
        }

        internal Task<LayoutReply> Send(string op, JObject fields)
        {
            var change = new JObject { { "op", op }, { "name", Name } };
            foreach (JProperty field in fields.Properties())
                if (field.Value.Type != JTokenType.Null) change[field.Name] = field.Value;
            return Session.LayoutChange(new object[] { change });
        }

        static JToken Json(object value) { return Haptix.Session.Json(value); }
    }

    public sealed partial class Session
    {
        const string Felt = "felt"; // name of the region that `Feel` makes
        Layout _layout;
        Material _felt; // null once the app has set a layout of its own

        /// <summary>Open a session and fill the screen with a material; what is returned has the `Session`.</summary>
        public static async Task<Region> Feel(string name, Material material, bool personAsked = false)
        {
            Session session = await Connect(name).ConfigureAwait(false);
            try { return await session.Feel(material, personAsked).ConfigureAwait(false); }
            catch (Exception)
            {
                session.Dispose();
                throw;
            }
        }

        /// <summary>
        /// Fill the screen with a material and arm: all that it takes to feel one. What was felt before is replaced.
        /// After a lost connection it is felt again, where it was felt until then: the layout as it was changed since, or
        /// on a service that was begun anew this material, with intensity, mute and pause as they were. A virtual driver is
        /// armed by itself, a real one only where a person asked; after `Stop`, `Release` or a layout of the app's own
        /// nothing is.
        /// </summary>
        public async Task<Region> Feel(Material material, bool personAsked = false)
        {
            await Show(material).ConfigureAwait(false);
            if (personAsked) await Arm().ConfigureAwait(false);
            else await ArmVirtual().ConfigureAwait(false);
            return Layout.Of(Felt);
        }

        async Task Show(Material material)
        {
            await Acquire().ConfigureAwait(false);
            double[] sizeMm = Welcome.Inventory.ScreenMm;
            var region = new JObject { { "name", Felt }, { "material", Json(material) }, { "x_mm", 0 }, { "y_mm", 0 },
                { "width_mm", sizeMm[0] }, { "height_mm", sizeMm[1] } };
            await Ask<LayoutReply>("layout_set", new JObject { { "document", new JObject { { "regions", new JArray(region) } } } }).ConfigureAwait(false);
            _felt = material;
        }

        async Task ArmVirtual()
        {
            if (!Array.Exists(Welcome.Inventory.Devices, device => device.IsReal)) await Arm().ConfigureAwait(false);
            else Tell(new Warning { Type = "warning", Sentence = "the driver is real: call Arm once a person asks for its voltage" });
        }

        /// <summary>Arm again what was felt before the connection was lost.</summary>
        async Task FeelAgain(Output before)
        {
            if (!Lease.IsMine) // a service that was begun anew: it has no layout
            {
                await Show(_felt).ConfigureAwait(false);
                await Intensity(before.Intensity).ConfigureAwait(false);
                await Mute(before.Muted).ConfigureAwait(false);
                await Pause(before.Paused).ConfigureAwait(false);
            }
            await ArmVirtual().ConfigureAwait(false);
        }

        /// <summary>What is felt where. The service keeps it for who connects again.</summary>
        public Layout Layout { get { return _layout ?? (_layout = new Layout(this)); } }

        /// <summary>Send a file that materials read, once; return `sha256:...`, by which a document calls it.</summary>
        public Task<string> Asset(string path)
        {
            return Task.Run(() =>
            {
                byte[] content = File.ReadAllBytes(path);
                long most = Welcome.Limits.AssetBytes;
                if (content.Length > most)  // the service would close the connection in the midst of the file
                    throw new Refused(new Error { Code = "limit", Path = "", Sentence =
                        Path.GetFileName(path) + " has " + content.Length + " bytes; expected at most " + most + ": send a smaller file" });
                string suffix = Path.GetExtension(path).ToLowerInvariant(), digest;
                using (SHA256 sha = SHA256.Create())
                    digest = BitConverter.ToString(sha.ComputeHash(content)).Replace("-", "").ToLowerInvariant();
                Service service = _find();
                var request = (HttpWebRequest)WebRequest.Create(service.Http("/v1/assets/" + digest + "?suffix=" + suffix));
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
