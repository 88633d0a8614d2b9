// Where the service is, for programs of this user: what service.json says.
namespace Haptix
{
    using System;
    using System.IO;
    using System.Security.Cryptography;
    using System.Text;
    using Newtonsoft.Json.Linq;

    public sealed class Service
    {
        public readonly string Url, Token;

        public Service(string url, string token)
        {
            Url = url;
            Token = token;
        }

        /// <summary>Return where the service of a session is asked by HTTP; both may lie behind a path of a proxy.</summary>
        public Uri Http(string path)
        {
            const string Session = "/v1/session";
            string http = "http" + Url.Substring(2).TrimEnd('/');
            return new Uri((http.EndsWith(Session) ? http.Substring(0, http.Length - Session.Length) : http) + path);
        }

        /// <summary>Return the running service. Its token is new at each start.</summary>
        public static Service Find()
        {
            string path = Path.Combine(Folder(), "service.json");
            if (!File.Exists(path)) throw new Lost("no service runs for this user: start haptix serve");
            JObject found = JObject.Parse(File.ReadAllText(path));
            return new Service((string)found["url"], (string)found["token"]);
        }

        /// <summary>Return the word by which the service knows an app again that crashed.</summary>
        internal static string WordOf(string name)
        {
            try
            {
                string hash;
                using (SHA256 sha = SHA256.Create())
                    hash = BitConverter.ToString(sha.ComputeHash(Encoding.UTF8.GetBytes(name))).Replace("-", "").ToLowerInvariant();
                string path = Path.Combine(Folder(), "apps", hash);
                if (File.Exists(path)) return File.ReadAllText(path);
                string word = Guid.NewGuid().ToString("N"), whole = path + "." + word;
                Directory.CreateDirectory(Path.GetDirectoryName(path));
                File.WriteAllText(whole, word);
                File.Move(whole, path);
                return word;
            }
            catch (IOException) { return ""; } // after a crash the output is then refused for 30 s
            catch (UnauthorizedAccessException) { return ""; }
        }

        static string Folder()
        {
            string chosen = Environment.GetEnvironmentVariable("HAPTIX_SERVICE");
            if (!string.IsNullOrEmpty(chosen)) return chosen;
            string home = Environment.GetFolderPath(Environment.SpecialFolder.UserProfile);
            string state = Environment.GetEnvironmentVariable("XDG_STATE_HOME");
            if (Path.DirectorySeparatorChar == '\\')
                state = Environment.GetFolderPath(Environment.SpecialFolder.LocalApplicationData);
            else if (Directory.Exists("/System/Library")) // macOS
                state = Path.Combine(home, "Library", "Application Support");
            else if (string.IsNullOrEmpty(state))
                state = Path.Combine(home, ".local", "state");
            return Path.Combine(state, "haptix", "service");
        }
    }

    /// <summary>The service refused a message; `Code` and `Path` say what and where.</summary>
    public sealed class Refused : Exception
    {
        public readonly string Code, Path;

        public Refused(Messages.Error error)
            : base(error.Path == "" ? error.Sentence : error.Sentence + " (" + error.Path + ")")
        {
            Code = error.Code;
            Path = error.Path;
        }
    }

    /// <summary>The connection is gone, or no answer came.</summary>
    public sealed class Lost : Exception
    {
        public Lost(string message) : base(message) { }
    }
}
