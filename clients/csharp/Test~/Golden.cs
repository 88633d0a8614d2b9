// The golden sessions, sent and read by this client's types, against the service of HAPTIX_SERVICE.
using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Text;
using System.Threading;
using Haptix;
using Newtonsoft.Json;
using Newtonsoft.Json.Linq;

static class Golden
{
    static readonly Dictionary<string, Type> Special = new Dictionary<string, Type>
    {
        { "layout", typeof(Haptix.Messages.LayoutReply) }, { "warning", typeof(Haptix.Messages.Warning) },
    };

    static IEnumerable<JObject> Lines(string path)
    {
        return File.ReadAllLines(path).Select(line => JObject.Parse(line));
    }

    static byte[] Bytes(string hex)
    {
        return Enumerable.Range(0, hex.Length / 2).Select(i => Convert.ToByte(hex.Substring(2 * i, 2), 16)).ToArray();
    }

    static byte[] Written(JObject line)
    {
        var touches = line["touches"].Select(each => new TouchReport
        {
            TimeS = (double)each["t_s"],
            TouchId = (int)each["touch_id"],
            Kind = (TouchKind)Enum.Parse(typeof(TouchKind), (string)each["kind"], true),
            InPixels = each["x_px"] != null,
            X = (float?)(each["x_px"] ?? each["x_mm"]) ?? 0f,
            Y = (float?)(each["y_px"] ?? each["y_mm"]) ?? 0f,
            NormalForceN = (float?)each["normal_force_n"],
            ContactAreaM2 = (float?)each["contact_area_m2"],
            Coalesced = (bool?)each["coalesced"] ?? false,
        }).ToList();
        byte[] bytes = Batches.Write(touches, (uint)line["number"]);
        Check.That(bytes.SequenceEqual(Bytes((string)line["hex"])), "touches " + line["hex"]);
        return bytes;
    }

    public static void Codec(string folder)
    {
        foreach (JObject line in Lines(Path.Combine(folder, "bytes.jsonl")))
        {
            if (line["frame"] == null)
            {
                Written(line);
                continue;
            }
            Frame frame = Batches.Read(Bytes((string)line["hex"]));
            JToken expected = line["frame"];
            var rows = expected["rows"].SelectMany(row => row).Select(n => n.Type == JTokenType.Null ? float.NaN : (float)n);
            Check.That(frame.Rows.SequenceEqual(rows), "rows " + line["hex"]);
            Check.That(frame.Stream == (string)expected["stream"] && frame.TouchId == (int)expected["touch_id"]
                && frame.Columns == (int)expected["columns"] && frame.Number == (uint)expected["number"]
                && frame.Dropped == (uint)expected["dropped"] && frame.T0S == (double)expected["t0_s"]
                && frame.StepS == (double)expected["step_s"], "frame " + line["hex"]);
        }
    }

    /// <summary>The message as this client's type reads and writes it; no field is lost.</summary>
    static void CheckType(JObject message)
    {
        string type = (string)message["type"];
        Type known;
        if (!Special.TryGetValue(type, out known))
        {
            string name = string.Concat(type.Split('_').Select(part => char.ToUpper(part[0]) + part.Substring(1)));
            known = typeof(Haptix.Messages.Welcome).Assembly.GetType("Haptix.Messages." + name, true);
        }
        JObject again = JObject.FromObject(message.ToObject(known));
        Check.That(JToken.DeepEquals(again, message), "the type of " + message + " gives " + again);
    }

    public static void Play(string path)
    {
        Service service = Service.Find();
        using (Link link = Link.Open(service.Url)) Play(path, service, link);
    }

    static void Play(string path, Service service, Link link)
    {
        var clock = Stopwatch.StartNew();
        Func<double> now = () => clock.Elapsed.TotalSeconds;
        var same = new Dictionary<string, JToken>();

        foreach (JObject line in Lines(path))
        {
            if ((string)line["from"] == "client")
            {
                Thread.Sleep(TimeSpan.FromSeconds(Math.Max((double)line["at_s"] - now(), 0)));
                if (line["hex"] != null)
                {
                    byte[] bytes = line["touches"] != null ? Written(line) : Bytes((string)line["hex"]);
                    if (line["touches"] != null) BitConverter.GetBytes(now()).CopyTo(bytes, 8);
                    link.Send(bytes, false);
                    continue;
                }
                JToken said = line["text"];
                string text = said.Type == JTokenType.String ? (string)said : said.ToString(Formatting.None);
                text = text.Replace("\"$now\"", JsonConvert.ToString(now())).Replace("$token", service.Token);
                link.Send(Encoding.UTF8.GetBytes(text), true);
                continue;
            }
            while (true)
            {
                JObject got = Receive(link);
                if (got["close"] == null) CheckType(got);
                JToken expected = line["text"] ?? new JObject { { "close", line["close"] } };
                if (Fits(expected, got, same)) break;
                if ((string)got["type"] == "ping")
                {
                    link.Send(new JObject { { "type", "pong" }, { "n", got["n"] }, { "clock_s", now() } });
                    continue;
                }
                Check.That((int?)got["id"] == 0 && (string)got["type"] != "error", line + " but " + got);
            }
        }
    }

    static JObject Receive(Link link)
    {
        while (true)
        {
            bool isText;
            byte[] data = link.Receive(TimeSpan.FromSeconds(100), out isText);
            if (data == null) return new JObject { { "close", link.CloseCode } };
            if (isText) return JObject.Parse(Encoding.UTF8.GetString(data));
        }
    }

    static bool Fits(JToken expected, JToken got, Dictionary<string, JToken> same)
    {
        if (expected.Type == JTokenType.String)
        {
            string text = (string)expected;
            if (text == "$any") return true;
            if (text.StartsWith("$same:"))
            {
                if (!same.ContainsKey(text)) same[text] = got;
                return JToken.DeepEquals(same[text], got);
            }
        }
        var fields = expected as JObject;
        if (fields == null) return JToken.DeepEquals(expected, got);
        var other = got as JObject;
        return other != null && fields.Count == other.Count
            && fields.Properties().All(each => other[each.Name] != null && Fits(each.Value, other[each.Name], same));
    }
}
